"""Several robots' routes: where they meet, what that costs, planning them together, and alternatives."""
