"""Plain data as objects: YAML files, mappings, specs go in; frozen dataclasses come out, or errors with file and line.

Start at `load` in `load.py` for dataclasses, at `yaml_file.py` for files, and at `spec.py` for `name(parameter=value)`.
"""
