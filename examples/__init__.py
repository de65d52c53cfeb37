"""Short programs that a user would write: bring your own simulator."""
