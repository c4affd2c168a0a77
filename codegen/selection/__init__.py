"""From the gains a method offers to the design that is kept: candidates, certified trials, the best of them."""
