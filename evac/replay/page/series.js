// Curves over time: who got out by which exit, who is on which stair and storey.

class Series {
  constructor(record, storeys) {
    this.record = record;
    const { exits, stairs } = record.building;
    const order = [...record.outTime.keys()].filter((p) => record.outTime[p] < Infinity);
    order.sort((a, b) => record.outTime[a] - record.outTime[b]);
    const timesOf = (people) => Float64Array.from(people, (p) => record.outTime[p]);
    this.out = timesOf(order);
    this.exits = exits.map((exit, index) => ({
      name: exit.name, times: timesOf(order.filter((p) => record.outBy[p] === index)),
    }));
    this.stairs = stairs.map((stair) => ({ name: stair.name, times: [], inside: new Uint32Array(record.frames) }));
    this.storeys = storeys.map((storey) => ({ name: storey.name, inside: new Uint32Array(record.frames) }));
    this.follow();
  }

  // Counts, frame by frame, who is on each stair and storey, and when somebody steps onto a stair.
  follow() {
    const { record } = this, { levels, stairs } = record.building;
    const { first, person, level, times } = record.motion;
    const stairOf = levels.map((one, index) => stairs.findIndex((stair) => stair.levels.includes(index)));
    const last = new Int32Array(record.people).fill(-1);
    for (let k = 0; k < record.frames; k++) {
      for (let row = first[k]; row < first[k + 1]; row++) {
        const stair = stairOf[level[row]];
        this.storeys[levels[level[row]].storey].inside[k]++;
        if (stair >= 0) this.stairs[stair].inside[k]++;
        if (stair >= 0 && last[person[row]] !== stair) this.stairs[stair].times.push(times[k]);
        last[person[row]] = stair;
      }
    }
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
