"""A study on a Dask cluster: here of two local processes, elsewhere of the machines that its scheduler has."""

from dask.distributed import Client, LocalCluster

import evac


def main():
    """Run a sweep and print its means; give the address of a scheduler to `Client` for another cluster."""
    case = evac.load("square_room", {"behaviours.walking": {}})
    cluster = LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None)
    with cluster, Client(cluster) as client:
        study = evac.sweep(case, {"people.people.number": [5, 10]}, 3, executor=client.get_executor())
    for point, statistics in zip(study.points, study.statistics, strict=True):
        print(point.label, f"{statistics.mean.value:.2f} s, {statistics.mean.low:.2f} to {statistics.mean.high:.2f} s")
    return study


if __name__ == "__main__":
    main()
