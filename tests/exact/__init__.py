"""The exact neo-Hookean finger that skin and devices are judged by: Newton's method in double precision."""
