"""What a finished design can do: detectability, comparison, replay of records."""
