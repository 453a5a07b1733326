"""State in, picture out: frames, a window, videos and charts. Needs the extra `render`."""
