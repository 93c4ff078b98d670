"""Readers of the field's file formats; each yields plain records and names file and line."""
