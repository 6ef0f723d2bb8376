"""Physics: one world is one Bullet client with the hand and one object."""
