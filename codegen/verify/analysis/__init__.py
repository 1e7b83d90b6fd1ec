"""Check 2: compare the findings of static analysers with the deviations of a build."""
