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
    this.placeOf = levels.map((level, index) => onStair[index] < 0 ? level.storey : storeys.length + onStair[index]);
    const places = [...storeys, ...stairs].map(({ name }) => ({ name, inside: new Count(0), entered: [] }));
    this.inside = new Count(0);
    this.count(places, record.moves);
    [this.storeys, this.stairs] = [places.slice(0, storeys.length), places.slice(storeys.length).sort(byName)];
  }

  // Counts who is inside and at each place, storeys and stairs, and notes when each person is there for the first time.
  count(places, { start, person, target, time }) {
    const at = start.map((level) => this.placeOf[level] ?? -1), known = places.map(() => new Uint8Array(at.length));
    at.forEach((place, p) => {
      if (place < 0) return;
      this.inside.numbers[0]++;
      places[place].inside.numbers[0]++;
      places[place].entered.push(-Infinity);
      known[place][p] = 1;
    });
    person.forEach((p, k) => {
      const [from, to, when] = [at[p], this.placeOf[target[k]] ?? -1, time[k] / 100];
      if (from === to) return;
      (places[from] ?? this).inside.add(when, from < 0 ? 1 : -1);
      (places[to] ?? this).inside.add(when, to < 0 ? -1 : 1);
      if (to >= 0 && !known[to][p]) places[to].entered.push(when);
      if (to >= 0) known[to][p] = 1;
      at[p] = to;
    });
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
