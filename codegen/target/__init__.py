"""What the C costs and does on its target."""
