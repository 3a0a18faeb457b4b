"""Task-driven design: how few motors a touch needs, and how to couple them. Source: [S2] IV."""
