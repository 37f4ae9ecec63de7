"""The documentation: its commands, pictures and links."""
