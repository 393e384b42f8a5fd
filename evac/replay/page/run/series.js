// Numbers of people over time, all counted from the same moves: who changed to which level, or came in or left, and when.

// Names in the order that people expect: north 2 before north 10.
const { compare } = new Intl.Collator("en", { numeric: true });
const byName = (a, b) => compare(a.name, b.name);

// A number of people that changes at times.
class Count {
  constructor(number) {
    this.times = [];
    this.numbers = [number];
  }

  add(time, change) {
    this.times.push(time);
    this.numbers.push(this.numbers.at(-1) + change);
  }

  at(time) { return this.numbers[countUpTo(this.times, time)]; }
}

class Series {
  constructor(record, storeys) {
    this.record = record;
    const { exits, stairs, levels } = record.building;
    const order = [...record.outTime.keys()].filter((p) => record.outTime[p] < Infinity);
    order.sort((a, b) => record.outTime[a] - record.outTime[b]);
    const timesOf = (people) => Float64Array.from(people, (p) => record.outTime[p]);
    this.order = order;
    this.out = timesOf(order);
    this.exits = exits.map((exit, index) => ({
      name: exit.name, index, times: timesOf(order.filter((p) => record.outBy[p] === index)),
    })).sort(byName);
    const onStair = levels.map((_, index) => stairs.findIndex((stair) => stair.levels.includes(index)));
    this.inside = this.place("inside", levels.map(() => true)).inside;
    this.stairs = stairs.map(({ name }, stair) => this.place(name, onStair.map((of) => of === stair))).sort(byName);
    this.storeys = storeys.map(({ name }, storey) => this.place(name, levels.map((level, index) => level.storey === storey && onStair[index] < 0)));
  }

  // Who is at a place that consists of levels, and when each person is there for the first time.
  place(name, isPart) {
    const { start, person, target, time } = this.record.moves, here = start.map((level) => level >= 0 && isPart[level]);
    const inside = new Count(here.filter(Boolean).length), entered = start.flatMap((_, p) => here[p] ? [-Infinity] : []), known = here.slice();
    person.forEach((p, k) => {
      const enters = target[k] >= 0 && isPart[target[k]];
      if (enters === here[p]) return;
      inside.add(time[k] / 100, enters ? 1 : -1);
      if (enters && !known[p]) entered.push(time[k] / 100);
      here[p] = enters;
      known[p] ||= enters;
    });
    return { name, inside, entered };
  }
}

// Number of ascending times up to a time.
function countUpTo(times, time) {
  let low = 0, high = times.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (times[middle] <= time + 1e-9) low = middle + 1; else high = middle;
  }
  return low;
}

// People per second who passed in the last seconds.
const FLOW_OVER = 5;
function flowAt(times, time, begin) {
  const since = Math.max(begin, time - FLOW_OVER);
  return time - since > 0.5 ? (countUpTo(times, time) - countUpTo(times, since)) / (time - since) : 0;
}
