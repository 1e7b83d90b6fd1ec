"""Check 6: drives and faults under sanitizers, here and on a core."""
