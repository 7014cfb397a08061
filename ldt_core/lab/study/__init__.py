"""Many runs of the loop on streams whose truth is known: the paper's study, and beyond it."""
