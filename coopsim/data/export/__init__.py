"""Exports: episodes of simulated environments come in, folders in the formats of data sets go out.

Start in `export_run`: it makes an `export_frame.ExportSource`, gives its frames to an `export_format`, and keeps
the card (`export_card`) and the checksums (`folder_checks`). Each format is a file.
"""
