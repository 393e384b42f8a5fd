"""Questions to a result folder in SQL: DuckDB reads the tables of a run, and the motion as a data frame."""

import duckdb

import evac

evac.run(evac.load("classroom", {"behaviours.walking": {}}), "result")

exits = duckdb.sql("""
    select "exit", count(*) as people, round(max(exit_time), 1) as last, round(avg(distance), 2) as walked
    from 'result/people.csv' where exit_time is not null group by "exit" order by "exit"
""")
print(exits)

motion = evac.read_trajectory("result").frame
slow = duckdb.sql("""
    select person, count(*) * 0.5 as seconds from motion
    where speed < 0.2 and time > 2.0 group by person order by seconds desc, person limit 3
""")
print(slow)

curve = duckdb.sql("""
    select time, number_out, number_out - lag(number_out, 1, 0) over (order by time) as more
    from 'result/egress.csv' order by time desc limit 1
""")
print(curve.fetchall())
