"""Check of scenarios, drives, faults and fuzzed inputs under sanitizers."""
