"""Learning sessions: which triples and entities take part, and how they are drawn."""
