"""What is asked of a kept embedding: answers, neighbours, what an insertion goes by, and what it would be without."""
