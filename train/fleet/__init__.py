"""A fleet in the words of VDA 5050 2.1.0: episodes as messages, and messages of real vehicles as episodes."""
