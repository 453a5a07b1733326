"""Adapters from the Simulator to PettingZoo, Gymnasium and stable-baselines3: reshaping only, no behaviour."""
