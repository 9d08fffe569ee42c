"""A worker as a process: `python -m gaussian_trimmer.batch.worker_process OUTPUT`, started by `local`."""

from __future__ import annotations

import json
import os
import queue
import signal
import sys
import threading
import time
import warnings
from typing import IO, Any

_SECONDS_TO_END = 5.0


def main() -> None:
    """Answer requests, a line of JSON each, until there are no more."""
    # Whatever a library prints must not get between the replies.
    replies = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    requests: queue.SimpleQueue[Any] = queue.SimpleQueue()
    busy = threading.Event()
    threading.Thread(target=_listen, args=(sys.stdin.buffer, requests, busy), daemon=True).start()
    warnings.simplefilter("ignore")

    import cv2

    from gaussian_trimmer.batch.storage import open_store
    from gaussian_trimmer.batch.worker import SceneWorker
    from gaussian_trimmer.io.stop_signals import Stopped, stop_signals_raised

    cv2.setNumThreads(int(os.environ.get("NUMBA_NUM_THREADS", "1")))
    worker = SceneWorker(open_store(sys.argv[1]))
    try:
        with stop_signals_raised():
            while (request := requests.get()) is not None:
                busy.set()
                reply = worker.serve(request)
                busy.clear()
                replies.write(json.dumps(reply).encode() + b"\n")
                replies.flush()
    except (Stopped, BrokenPipeError):
        pass
    finally:
        worker.close()


def _listen(stream: IO[bytes], requests: queue.SimpleQueue[Any], busy: threading.Event) -> None:
    """Pass requests on; when the driver is gone, stop what is being done."""
    for line in stream:
        requests.put(json.loads(line))
    requests.put(None)
    if busy.is_set():
        os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(_SECONDS_TO_END)
    os._exit(1)


if __name__ == "__main__":
    main()
