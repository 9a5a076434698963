"""What all packages need to write, print or encode values: JSON, CSV, arrays, digits, the terminal."""
