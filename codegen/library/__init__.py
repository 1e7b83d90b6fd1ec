"""The functions and results that `import codegen` offers. Each command prints what one of these functions returns."""
