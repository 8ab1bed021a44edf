"""Maps of others, read into one form, `StreetMap`, which no simulation depends on."""
