"""The closed loop: plant, navigation, law and actuator, N cases at once."""
