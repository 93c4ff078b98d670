"""What is believed at first: from sensors alone, by least squares from many starts."""
