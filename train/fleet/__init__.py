"""A fleet in the words of VDA 5050: episodes as messages, and messages of real vehicles as episodes."""
