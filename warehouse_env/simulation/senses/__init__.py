"""What a robot perceives, predicts, prefers, is told and is rewarded."""
