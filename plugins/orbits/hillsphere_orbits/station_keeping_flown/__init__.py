"""Station-keeping in the closed loop: strategies, correction intervals and what survives."""
