"""`python -m cavirheo`."""

from cavirheo.verbs import entry

if __name__ == "__main__":
    entry()
