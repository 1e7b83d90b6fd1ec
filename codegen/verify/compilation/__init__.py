"""Check 1: whether the C compiles everywhere without a warning, and refuses what would break it."""
