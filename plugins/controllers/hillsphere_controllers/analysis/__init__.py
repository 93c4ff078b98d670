"""Analysis of linear systems: norms, frequency responses, margins."""
