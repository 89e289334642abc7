"""Files from which ``isi import`` makes a home."""
