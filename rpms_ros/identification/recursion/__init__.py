"""The recursion for people: one pass over the samples, a state of fixed size."""
