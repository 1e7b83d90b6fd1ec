"""What leaves the project for other tools."""
