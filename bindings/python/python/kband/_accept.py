"""Ranges of plain numbers."""


def accept(low: float, high: float, **values: float | None) -> None:
    """Refuses values out of range; None stands for a default."""
    for name, value in values.items():
        if value is not None and not low <= value <= high:
            raise ValueError(f"{name} = {value} is refused; accepted: {low}..{high}")


def accept_run(seed: int = 1, threads: int | None = None, order: int = 1) -> None:
    """Refuses a seed, a number of threads or an order out of range."""
    accept(0, 2**64 - 1, seed=seed)
    accept(1, 1024, threads=threads)
    accept(1, 100, order=order)
