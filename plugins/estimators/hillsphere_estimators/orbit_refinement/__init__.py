"""The orbit of an asteroid, first from telescopes, then by spacecraft that draw near."""
