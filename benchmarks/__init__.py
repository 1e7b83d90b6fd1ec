"""Measured against peers, in one run on one machine: `python -m benchmarks [NAME…] [--quick]`. No test asserts a time."""
