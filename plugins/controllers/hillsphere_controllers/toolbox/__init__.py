"""The flat namespace of control engineers: thin functions under their usual names."""
