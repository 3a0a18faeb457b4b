"""Example scenes that show what Dermis does, built from nothing."""
