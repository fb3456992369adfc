"""Case files: TOML, validated, and converted to a problem and its solver."""
