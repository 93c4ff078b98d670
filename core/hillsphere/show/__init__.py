"""Presentation: tables, figures, the report."""
