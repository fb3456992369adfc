"""A TOML case file, checked, and turned into a problem and its solver."""
