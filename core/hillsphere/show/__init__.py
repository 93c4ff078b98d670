"""Presentation of results: metrics, tables, figures, comparison with papers, and the report."""
