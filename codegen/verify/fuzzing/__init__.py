"""Check 7: fuzzing, the part with a fixed number of inputs."""
