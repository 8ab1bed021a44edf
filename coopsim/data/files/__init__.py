"""Readers and writers of single files of foreign formats, for exports and recordings alike."""
