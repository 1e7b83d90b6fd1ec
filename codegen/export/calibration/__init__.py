"""Calibration data of a build: read and written as DCM 2.0 and CDF 2.0, checked, compared, and patched into images."""
