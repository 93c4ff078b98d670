"""Stages of a mission: linear models, their LFT, synthesis of a controller, analysis by µ."""
