"""An A2L with the addresses of an ELF."""
