"""The fake board: the same ports as the kernel's, with chips, a rail and a body behind them."""
