"""Check 2: what static analysers find, held against the build's deviations."""
