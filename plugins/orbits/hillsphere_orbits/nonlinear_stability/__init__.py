"""How large an error a periodic orbit bears: flown, not linearised."""
