"""Check 3: processor in the loop, bit for bit what the host computes."""
