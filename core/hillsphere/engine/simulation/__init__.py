"""Closed-loop simulation of plant, navigation, control law and actuator for N cases at once."""
