"""Hands that people own: which bones are fingertips, where their skin is, and fingers that are attached there."""
