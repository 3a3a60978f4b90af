"""Servers on the loopback address: HTTP with ranges, and S3 by moto."""

import contextlib
import re
import threading
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path


class RangeHandler(SimpleHTTPRequestHandler):
    """Serve the files of a folder, and ranges of them."""

    def do_HEAD(self):
        if self.server.status is None:
            super().do_HEAD()
        else:
            self.send_error(self.server.status)

    def do_GET(self):
        if self.server.status is not None:
            self.send_error(self.server.status)
            return
        wanted = re.fullmatch(r"bytes=(\d+)-(\d+)", self.headers.get("Range", ""))
        path = Path(self.translate_path(self.path))
        if wanted is None or not self.server.ranges or not path.is_file():
            self.server.requests.append((self.path, None))
            super().do_GET()
            return
        start, last = int(wanted[1]), min(int(wanted[2]), path.stat().st_size - 1)
        self.server.requests.append((self.path, last - start + 1))
        with path.open("rb") as file:
            file.seek(start)
            content = file.read(last - start + 1)
        self.send_response(206)
        self.send_header("Content-Length", str(len(content)))
        self.send_header("Content-Range", f"bytes {start}-{last}/{path.stat().st_size}")
        self.end_headers()
        self.wfile.write(content)

    def end_headers(self):
        if self.server.ranges:
            self.send_header("Accept-Ranges", "bytes")
        super().end_headers()

    def log_message(self, *_):
        pass


@contextlib.contextmanager
def http_server(folder, ranges=True, status=None):
    """Yield a server of a folder, with the attributes `url` and `requests`: (path, bytes).

    With a `status`, it answers each request with this error.
    """

    def handler(*args):
        return RangeHandler(*args, directory=str(folder))

    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        server.requests, server.ranges, server.status = [], ranges, status
        server.url = f"http://127.0.0.1:{server.server_port}"
        thread = threading.Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        try:
            yield server
        finally:
            server.shutdown()
            thread.join()


@contextlib.contextmanager
def s3_server():
    """Yield the endpoint of a new S3-compatible server: the one of moto, with requests by boto."""
    from moto.server import ThreadedMotoServer

    server = ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    server.start()
    try:
        host, port = server.get_host_and_port()
        yield f"http://{host}:{port}"
    finally:
        server.stop()
