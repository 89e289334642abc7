"""Recording scenes from the live simulator, into a file that sources read; no stage of a pipeline does."""
