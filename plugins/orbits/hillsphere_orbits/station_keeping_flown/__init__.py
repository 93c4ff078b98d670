"""Station-keeping in the closed loop: strategies, correction intervals and survival."""
