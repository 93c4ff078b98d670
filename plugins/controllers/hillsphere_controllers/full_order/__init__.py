"""Controllers of full order: H∞ and H2 by Riccati equations."""
