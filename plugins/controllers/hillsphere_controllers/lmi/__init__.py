"""Synthesis and analysis by linear matrix inequalities (LMIs)."""
