"""What an orbit sees of its body, and when the Sun shines on both."""
