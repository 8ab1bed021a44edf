"""Plain data as objects: YAML files and mappings into frozen dataclasses, with file and line in errors."""
