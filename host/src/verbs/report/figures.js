"use strict";
const feeder = data.feeder;

/** mm of a k at a frequency in Hz: b = g cos(alpha) / (k w^2). */
function millimetres(k, frequency) {
  const w = 2 * Math.PI * frequency;
  return 1e3 * feeder.gravity_m_s2 * Math.cos(feeder.incline_degrees * Math.PI / 180) / (k * w * w);
}

const span = (values, room = 0.06) => {
  const there = values.filter((value) => value !== null && Number.isFinite(value));
  const low = Math.min(0, ...there), high = Math.max(...there, 1e-9);
  return { low: low < 0 ? low * (1 + room) : low, high: high * (1 + room) };
};

// Bands over restitution, the lot, and the drive's frequency.
{
  const { restitution, orders } = data.bands;
  const chart = new Chart("bands", () => {
    if (low.index > high.index) (document.activeElement.id === "lot-low" ? high : low).index = document.activeElement.id === "lot-low" ? low.index : high.index;
    const of = orders[order.index], at = frequency.value;
    const mm = (k) => millimetres(k, at);
    // Both edges grow with R: from the flip of the liveliest part to the birth of the deadest.
    const flip = of.k_low[high.index], birth = of.k_high[low.index], common = flip < birth;
    const setpoint = 2 / (1 / flip + 1 / birth), margin = 100 * (1 - setpoint / birth);
    const all = orders.filter((one) => one.order <= of.order).flatMap((one) => one.k_low.slice(8).map(mm));
    return {
      x: { label: "restitution R", low: 0, high: restitution.at(-1) },
      y: { label: "amplitude b", unit: "mm", low: 0, high: span(all).high },
      height: 360,
      layers: [
        ...orders.map((one, n) => ({ kind: "area", series: n, name: `locks of order ${one.order}`, points: restitution.map((r, m) => [r, mm(one.k_high[m]), mm(one.k_low[m])]) })),
        ...(common ? [{ kind: "strip", low: mm(birth), high: mm(flip), name: "shared by the lot" }, { kind: "level", y: mm(setpoint), name: `setpoint ${formatNumber(mm(setpoint))} mm` }] : []),
        { kind: "mark", x: low.value, name: "lot" }, { kind: "mark", x: high.value, name: "" },
      ],
      verdict: common
        ? `R ${formatNumber(low.value)}..${formatNumber(high.value)}, order ${of.order}, ${formatNumber(at)} Hz: every part locks from ${formatNumber(mm(birth))} to ${formatNumber(mm(flip))} mm; setpoint ${formatNumber(mm(setpoint))} mm, margin ${formatNumber(margin, 3)} % of it.`
        : `R ${formatNumber(low.value)}..${formatNumber(high.value)}, order ${of.order}, ${formatNumber(at)} Hz: no amplitude locks every part of this lot; sort it into narrower ones.`,
      read: (x, y) => {
        const n = nearest(restitution, x), inside = orders.find((one) => y >= mm(one.k_high[n]) && y <= mm(one.k_low[n]));
        return `R ${formatNumber(restitution[n])}, b ${formatNumber(y)} mm (k ${formatNumber(millimetres(1, at) / y)}): ` + (inside ? `locks of order ${inside.order}` : "no lock of one impact a period, order 1 to 3");
      },
      numbers: () => ({
        heads: ["R", ...orders.flatMap((one) => [`order ${one.order}, from / mm`, "to / mm"])],
        rows: restitution.map((r, n) => [r, ...orders.flatMap((one) => [mm(one.k_high[n]), mm(one.k_low[n])])]),
      }),
    };
  });
  const r = (value) => "R " + formatNumber(value);
  const low = chart.slider("lot-low", "the lot's deadest part", restitution, nearest(restitution, feeder.restitution_low), r);
  const high = chart.slider("lot-high", "the lot's liveliest part", restitution, nearest(restitution, feeder.restitution_high), r);
  const order = chart.slider("order", "order: drive cycles in a flight", orders.map((one) => one.order), Math.min(feeder.order, orders.length) - 1, String);
  const all = [...new Set([...Array.from({ length: 40 }, (_, n) => 5 + 5 * n), feeder.frequency_hz])].sort((a, b) => a - b);
  const frequency = chart.slider("frequency", "frequency of the drive", all, all.indexOf(feeder.frequency_hz), (value) => formatNumber(value) + " Hz");
}

// Share of time in gear.
{
  const gear = data.gear, b = gear.amplitude_mm;
  const two = `two tones, e = ${formatNumber(gear.second_tone)} at ${formatNumber(gear.second_tone_angle_rad * 180 / Math.PI, 3)}°`;
  const chart = new Chart("gear", () => {
    const one = gear.one_tone[scatter.index], both = gear.two_tones[scatter.index];
    const curve = (values) => b.map((x, n) => [x, values[n]]);
    const best = one.mean.indexOf(Math.max(...one.mean)), bestOfTwo = both.mean.indexOf(Math.max(...both.mean));
    return {
      x: { label: "amplitude b", unit: "mm", low: b[0], high: b.at(-1) },
      y: { label: "share of time in gear", low: 0, high: 1.04 },
      layers: [
        { kind: "line", series: 0, name: "one tone, mean of the lot", points: curve(one.mean) },
        { kind: "line", series: 2, name: "one tone, part that is in gear least", points: curve(one.least) },
        { kind: "line", series: 1, name: two + ", mean of the lot", points: curve(both.mean) },
        { kind: "points", series: 0, points: [[b[best], one.mean[best]]] },
      ],
      verdict: `Scatter ${formatNumber(scatter.value)}: at best in gear ${formatNumber(100 * one.mean[best], 3)} % of the time, at ${formatNumber(b[best])} mm; with a second tone ${formatNumber(100 * both.mean[bestOfTwo], 3)} %, at ${formatNumber(b[bestOfTwo])} mm.`,
      read: (x) => { const n = nearest(b, x); return `b ${formatNumber(b[n])} mm (k ${formatNumber(gear.k[n])}): mean ${formatNumber(one.mean[n], 3)}, least ${formatNumber(one.least[n], 3)}; two tones ${formatNumber(both.mean[n], 3)}`; },
      numbers: () => ({ heads: ["b / mm", "k", "mean", "least", "two tones, mean", "least"], rows: b.map((x, n) => [x, gear.k[n], one.mean[n], one.least[n], both.mean[n], both.least[n]]) }),
    };
  });
  const scatter = chart.slider("scatter", "scatter of restitution from impact to impact", gear.scatter, gear.scatter_of_the_lot, (value) => "s " + formatNumber(value));
}

// Basins.
{
  const { maps, side, velocity_top, phase_top, band_mm, restitution } = data.basins;
  const chart = new Chart("basins", () => {
    const map = amplitude.value, used = [...new Set(map.signs)].sort();
    return {
      x: { label: "phase of the drive at the start", unit: "rad", low: 0, high: phase_top },
      y: { label: "velocity at the start", unit: "b w", low: 0, high: velocity_top },
      height: 440, plane: true,
      cells: { side, signs: map.signs, legend: used.map((fill) => [fill, data.fills[fill]]) },
      layers: [{ kind: "points", series: 1, name: map.locks.length ? "the locked orbit" : "", points: map.locks.filter(([, v]) => v <= velocity_top) }],
      verdict: `R ${formatNumber(restitution)} at ${formatNumber(map.amplitude_mm)} mm (k ${formatNumber(map.k)}; its band is ${formatNumber(band_mm[0])}..${formatNumber(band_mm[1])} mm): ` +
        map.shares.slice(0, 4).map((one) => `${one.regime} ${formatNumber(100 * one.share, 3)} %`).join(", ") + `. From rest: ${map.from_rest}.`,
      read: (x, y) => {
        const column = Math.min(Math.floor(x / phase_top * side), side - 1), row = Math.min(Math.floor(y / velocity_top * side), side - 1);
        return `phase ${formatNumber(x, 3)} rad, velocity ${formatNumber(y, 3)} b w: ${data.fills[map.signs[row * side + column]]}`;
      },
      numbers: () => ({ heads: ["regime", "share / %"], rows: map.shares.map((one) => [one.regime, 100 * one.share]) }),
    };
  });
  const middle = (band_mm[0] + band_mm[1]) / 2;
  const amplitude = chart.slider("basin", "amplitude of the track", maps, nearest(maps.map((map) => map.amplitude_mm), middle), (map) => formatNumber(map.amplitude_mm) + " mm");
}

// Conveying speed.
{
  const { friction, friction_of_the_scene, given, curves, restitution } = data.transport;
  const names = { S: 0, "H-S": 1, H: 2 };
  const every = span(curves.flatMap((curve) => curve.rows.map((row) => row[2])));
  const chart = new Chart("transport", () => {
    const { rows } = mu.value, b = rows.map((row) => row[1]);
    const fastest = rows.reduce((best, row) => (row[2] ?? -Infinity) > (best[2] ?? -Infinity) ? row : best);
    const ribbon = rows.map((row, n) => [n ? (b[n - 1] + b[n]) / 2 : b[0], n + 1 < b.length ? (b[n] + b[n + 1]) / 2 : b[n], names[row[3]]]);
    return {
      x: { label: "amplitude b", unit: "mm", low: b[0], high: b.at(-1) },
      y: { label: "conveying speed", unit: "mm/s", ...every },
      ribbon, fills: ["S: always in contact", "H-S: hops and lies", "H: hops on"],
      layers: [{ kind: "line", series: 0, name: `friction ${formatNumber(mu.value.friction)}`, points: rows.map((row) => [row[1], row[2]]) }, { kind: "level", y: 0, name: "" }],
      verdict: fastest[2] === null ? "Friction does not hold the part on this incline."
        : `R ${formatNumber(restitution)}, friction ${formatNumber(mu.value.friction)}${given ? "" : " (the scene names none)"}: fastest ${formatNumber(fastest[2])} mm/s at ${formatNumber(fastest[1])} mm, throw number ${formatNumber(fastest[0], 3)}.`,
      read: (x) => { const row = rows[nearest(b, x)]; return `b ${formatNumber(row[1])} mm, throw number ${formatNumber(row[0], 3)}: ${formatNumber(row[2])} mm/s, ${row[3]}`; },
      numbers: () => ({ heads: ["throw number", "b / mm", "speed / mm/s", "regime"], rows }),
    };
  });
  const mu = chart.slider("friction", "friction of parts on the track", curves, friction_of_the_scene, (curve) => "μ " + formatNumber(curve.friction));
}

// The run: three pictures with one cursor in time.
if (data.run) {
  const run = data.run, times = Array.from({ length: 501 }, (_, n) => run.duration_s * n / 500);
  const x = { label: "time", unit: "s", low: 0, high: run.duration_s };
  const at = (points, time) => points[nearest(points.map((point) => point[0]), time)]?.[1];
  const state = (time) => (run.states.find(([from, to]) => time >= from && time <= to) || run.states.at(-1))[3];
  // Events that would write over each other stand one below the other.
  let last = [-Infinity, 0];
  const marks = run.events.map(([time, name]) => {
    const close = time - last[0] < 0.2 * run.duration_s;
    last = [time, close ? (last[1] + 1) % 8 : 0];
    return { kind: "mark", x: time, name, row: last[1] };
  });
  const here = () => ({ kind: "mark", x: time.value, name: "", row: 0 });
  const charts = [];
  const chart = new Chart("amplitude", () => {
    for (const other of charts) other.draw();
    return {
      x, y: { label: "amplitude b", unit: "mm", low: 0, high: span([...run.amplitude_mm, ...run.reference_mm].map((point) => point[1])).high }, height: 340,
      ribbon: run.states, fills: run.state_fills,
      layers: [{ kind: "line", series: 0, name: "measured", points: run.amplitude_mm }, { kind: "line", series: 1, name: "asked for", points: run.reference_mm }, ...marks, here()],
      verdict: `At ${formatNumber(time.value)} s: ${state(time.value)}, b ${formatNumber(at(run.amplitude_mm, time.value))} mm, k ${formatNumber(at(run.k, time.value))}, in gear ${formatNumber(at(run.in_gear_estimated, time.value), 3)} as heard.`,
      read: (t) => `${formatNumber(t)} s: ${state(t)}, b ${formatNumber(at(run.amplitude_mm, t))} mm, asked for ${formatNumber(at(run.reference_mm, t))} mm, k ${formatNumber(at(run.k, t))}`,
      numbers: () => ({ heads: ["time / s", "event"], rows: run.events }),
    };
  });
  const time = chart.slider("time", "time", times, 500, (value) => formatNumber(value) + " s");
  charts.push(new Chart("phases", () => ({
    x, y: { label: "phase at impact", unit: "rad", low: 0, high: 2 * Math.PI }, height: 260,
    layers: [...run.parts.map((part, series) => ({ kind: "points", series, name: part.name, points: part.impacts })), ...(run.lock_phase_rad === null ? [] : [{ kind: "level", y: run.lock_phase_rad, name: "the lock" }]), here()],
    read: (t, y) => { const near = run.parts.flatMap((part) => part.impacts.map((one) => [...one, part.name])).reduce((best, one) => Math.hypot((one[0] - t) / run.duration_s, (one[1] - y) / 6) < Math.hypot((best[0] - t) / run.duration_s, (best[1] - y) / 6) ? one : best, [Infinity, 0, 0]);
      return near[0] === Infinity ? `${formatNumber(t)} s: no impact` : `impact at ${formatNumber(near[0])} s: phase ${formatNumber(near[1], 3)} rad, ${formatNumber(1e3 * near[2], 3)} mm/s (${near[3]})`; },
    plane: true,
    numbers: () => ({ heads: ["part", "time / s", "phase / rad", "speed / m/s"], rows: run.parts.flatMap((part) => part.impacts.map((one) => [part.name, ...one])) }),
  })));
  charts.push(new Chart("share", () => ({
    x, y: { label: "share in gear", low: 0, high: 1.05 }, height: 200,
    layers: [{ kind: "line", series: 0, name: "estimated", points: run.in_gear_estimated }, ...(run.in_gear_true === null ? [] : [{ kind: "level", y: run.in_gear_true, name: "true, mean" }]), here()],
    read: (t) => `${formatNumber(t)} s: in gear ${formatNumber(at(run.in_gear_estimated, t), 3)} (estimated)`,
    numbers: () => ({ heads: ["time / s", "in gear, estimated"], rows: run.in_gear_estimated }),
  })));
}
coloured();
document.documentElement.dataset.ready = "yes";
