"""The whole of a design, shown to a person: one HTML file, and the plots in it."""
