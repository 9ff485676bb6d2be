"""Hard contacts as a step sees them: where they are, what impulses do there, and which impulses they take."""
