"""A web service: POST /runs with keys of a case starts a run, GET /runs/NUMBER tells how far it is, or its results."""

import itertools
import json
from concurrent.futures import ThreadPoolExecutor
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import evac

RUNS = {}  # by number: a future of results, and the latest progress
NUMBERS = itertools.count(1)
WORKERS = ThreadPoolExecutor(2)  # runs at the same time; each is one thread


def start(changes):
    """Check the changes, start a run, and return its number; an EvacError says what is wrong."""
    case, number, progress = evac.load("square_room", changes), next(NUMBERS), {}
    done = WORKERS.submit(evac.run, case, progress=lambda now: progress.update(time=now.time, out=now.out))
    RUNS[number] = done, progress
    return number


def state(number):
    """Return how far a run is, or its results."""
    done, progress = RUNS[number]
    if not done.done():
        return {"state": "running", **progress}
    results = done.result()
    return {"state": results.ended, "out": results.evacuated, "last_out": results.last_out}


class Service(BaseHTTPRequestHandler):
    """Answers in JSON."""

    def answer(self, status, content):
        """Send an answer."""
        body = json.dumps(content).encode()
        self.send_response(status)
        self.send_header("Content-Type", "application/json")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def do_POST(self):
        """Start a run."""
        given = self.rfile.read(int(self.headers["Content-Length"]))
        try:
            self.answer(201, {"run": start(json.loads(given))})
        except (ValueError, evac.EvacError) as error:
            self.answer(400, {"error": str(error)})

    def do_GET(self):
        """Tell about a run."""
        number = self.path.rpartition("/")[2]
        known = number.isdecimal() and int(number) in RUNS
        self.answer(200 if known else 404, state(int(number)) if known else {"error": "no such run"})


if __name__ == "__main__":
    ThreadingHTTPServer(("127.0.0.1", 8000), Service).serve_forever()
