"""The writer of OpenDRIVE. Start in `document`."""
