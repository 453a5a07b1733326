"""What happens to bodies: motion, shapes, contact, the floor and its edges, people on foot."""
