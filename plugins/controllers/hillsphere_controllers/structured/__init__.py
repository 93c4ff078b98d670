"""H∞ and H2 synthesis of controllers of a fixed structure, for one or many plants."""
