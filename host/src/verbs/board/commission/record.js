"use strict";
data.commissioning.forEach((step, n) => {
  const rows = step.telemetry, end = rows.length ? rows.at(-1).time : 1;
  const of = (key) => rows.map((row) => [row.time, row[key]]);
  const top = (...keys) => 1.08 * Math.max(1e-6, ...keys.flatMap((key) => rows.map((row) => row[key] ?? 0)));
  const x = { label: "time", unit: "s", low: 0, high: end || 1 };
  const read = (time) => {
    if (!rows.length) return "the board sent no telemetry";
    const row = rows[nearest(rows.map((row) => row.time), time)];
    return `${formatNumber(row.time)} s: ${row.state}, b ${formatNumber(row.b)} mm, setpoint ${formatNumber(row.setpoint_b)} mm, k ${formatNumber(row.k)}, output ${formatNumber(row.output, 3)}, in gear ${formatNumber(row.in_gear_estimated, 3)}`;
  };
  const numbers = () => ({
    heads: ["time / s", "b / mm", "setpoint / mm", "k", "output", "impacts a cycle", "in gear estimated", "state"],
    rows: rows.map((row) => [row.time, row.b, row.setpoint_b, row.k, row.output, row.impacts_detected, row.in_gear_estimated, row.state]),
  });
  new Chart("amplitude-" + n, () => ({
    x, y: { label: "amplitude b", unit: "mm", low: 0, high: top("b", "setpoint_b") }, height: 240, read, numbers,
    layers: [{ kind: "line", series: 0, name: "measured", points: of("b") }, { kind: "line", series: 1, name: "asked for", points: of("setpoint_b") }],
  }));
  new Chart("shares-" + n, () => ({
    x, y: { label: "share", low: 0, high: 1.05 }, height: 200, read, numbers,
    layers: [{ kind: "line", series: 0, name: "output", points: of("output") }, { kind: "line", series: 1, name: "in gear, estimated", points: of("in_gear_estimated") }],
  }));
});
coloured();
document.documentElement.dataset.ready = "yes";
