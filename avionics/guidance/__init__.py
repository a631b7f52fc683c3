"""What the aircraft intends: modes, missions, and the outer loops from place and altitude to attitude."""
