"""Batches that are drawn while the step before them is computed."""

from concurrent.futures import Future, ThreadPoolExecutor
from types import TracebackType

from jotlight.torch.patches import Batch, PatchLoader


class AheadLoader:
    """Batches of a :class:`PatchLoader`. A thread draws the next one during each step.

    A batch depends only on its step, so the batches are those of the loader.

    Parameters
    ----------
    loader : PatchLoader
        The source of the batches.
    shard : slice
        The patches of this process.
    last : int
        The last step. No batch after it is drawn ahead.

    Examples
    --------
    >>> from jotlight.training import SyntheticPatches
    >>> network = jl.Network.conditional("small", rng=0)
    >>> loader = PatchLoader(SyntheticPatches(), network, jl.Sensor(), 0, batch_size=2, side=32)
    >>> with AheadLoader(loader, slice(None), last=9) as ahead:
    ...     ahead.batch(step=0, threads=1).data.shape
    torch.Size([2, 1, 32, 32])
    """

    def __init__(self, loader: PatchLoader, shard: slice, last: int) -> None:
        self.loader, self.shard, self.last = loader, shard, last
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="jotlight-batches")
        self._next: tuple[int, Future[Batch]] | None = None

    def __enter__(self) -> "AheadLoader":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._pool.shutdown(cancel_futures=True)

    def batch(self, step: int, threads: int) -> Batch:
        """Return the batch of a step, and begin that of the next one."""
        if self._next is not None and self._next[0] == step:
            batch = self._next[1].result()
        else:
            batch = self.loader.batch(step, self.shard, threads)
        if step < self.last:
            following = self._pool.submit(self.loader.batch, step + 1, self.shard, threads)
            self._next = step + 1, following
        return batch
