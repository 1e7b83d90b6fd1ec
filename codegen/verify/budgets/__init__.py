"""Check 4: instructions, stack, flash and RAM on a Cortex-M4F."""
