"""The parts of docs/ that come from the code: tables of the reference pages, and figures."""
