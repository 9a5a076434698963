"""The browser app: five guided steps over the same functions as the command line (docs/how-to/app.md)."""
