"""The reference map as a file: the `.npz` contract, reading, checking and writing."""
