"""Contracts of the generated C: what each function requires and ensures, as C that a model checker reads."""
