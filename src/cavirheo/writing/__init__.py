"""What all packages need to write, print, draw or encode values: JSON, CSV, arrays, digits, figures, the terminal."""
