/* Copyright 2026 rpms_ros contributors */
/* SPDX-License-Identifier: Apache-2.0 */
/* The viewer of the force: uPlot draws; what is here chooses the data and moves the view. */
(function () {
  'use strict';
  const element = (id) => document.getElementById(id);
  const traces = JSON.parse(element('traces').textContent);
  const place = element('plots');
  if (place === null) { return; }
  const numbers = (text) =>
    new Float32Array(Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer);

  /* uPlot leaves a gap where a value is null. */
  const withGaps = (values) => Array.from(values, (value) => Number.isNaN(value) ? null : value);

  function source(packed, start) {
    const time = Float64Array.from(numbers(packed.time), (value) => value + start);
    const measured = numbers(packed.measured), modelled = numbers(packed.modelled);
    const residual = packed.residual ? numbers(packed.residual)
      : measured.map((value, index) => value - modelled[index]);
    return { label: packed.label, first: time[0], last: time[time.length - 1],
      force: [time, measured, withGaps(modelled)], residual: [time, withGaps(residual)] };
  }
  const windows = traces.windows.map((packed) => source(packed, packed.start));
  const envelope = traces.envelope && source(traces.envelope, 0);
  let view = [0, traces.end], drawn = null;

  function plot(share, label, series, limit) {
    const grid = { stroke: '#dedede', width: 1 };
    return new uPlot({
      width: place.clientWidth, height: Math.round(share * 416),
      scales: { x: { time: false, range: () => view }, y: limit ? { range: () => [-limit, limit] } : {} },
      axes: [{ label: share < 0.5 ? 'time / s' : '', labelSize: 20, size: 36, grid },
        /* With the usual 30 pixels between ticks a low plot may have a single one, at 0. */
        { label, size: 60, labelSize: 20, grid, ...(share < 0.5 ? { space: 20 } : {}) }],
      series: [{ label: 'time / s', value: (_, value) => value === null ? '' : value.toFixed(3) },
        ...series],
      cursor: { sync: { key: 'force' }, drag: { x: false, y: false } },
    }, null, place);
  }
  const line = (label, stroke, width) => ({ label, stroke, width, points: { show: false } });

  element('viewer').hidden = false;
  element('still').hidden = true;
  const plots = {
    force: plot(0.7, `${traces.quantity} / ${traces.unit}`, [line('measured', '#a0a0a0', 3), line('modelled', '#000', 1)]),
    residual: plot(0.4, `residual / ${traces.unit}`, [line('measured minus modelled', '#000', 0.8)],
      traces.residual_limit),
  };

  /* Every sample where the whole view lies in a window that has them, else the envelope. */
  function draw() {
    const inside = (one) => one.first <= view[0] + 1e-6 && one.last >= view[1] - 1e-6;
    drawn = windows.find(inside) || envelope || windows[0];
    for (const name of Object.keys(plots)) { plots[name].setData(drawn[name]); }
    const how = drawn === envelope ? 'envelope' : 'every sample';
    element('shown').textContent = `${view[0].toFixed(3)} to ${view[1].toFixed(3)} s, ${how}`;
    place.dataset.view = view.join(' ');
  }

  function show(from, to) {
    const length = Math.min(traces.end, Math.max(1e-3, to - from));
    const start = Math.min(Math.max(0, from), traces.end - length);
    view = [start, start + length];
    draw();
  }
  function zoom(factor, around = (view[0] + view[1]) / 2) {
    show(around - (around - view[0]) * factor, around + (view[1] - around) * factor);
  }
  function move(share) {
    const step = share * (view[1] - view[0]);
    show(view[0] + step, view[1] + step);
  }
  function timeAt(event) {
    const box = plots.force.over.getBoundingClientRect();
    return view[0] + (event.clientX - box.left) / box.width * (view[1] - view[0]);
  }
  function button(label, from, to) {
    const made = document.createElement('button');
    made.type = 'button';
    made.textContent = label;
    made.addEventListener('click', () => show(from, to));
    element('ranges').append(made);
  }

  button('all', 0, traces.end);
  if (envelope) {
    for (const one of windows) { button(one.label, one.first, one.last); }
  } else {
    button('last 2 s', traces.end - 2, traces.end);
  }
  for (const one of document.querySelectorAll('[data-zoom]')) {
    one.addEventListener('click', () => zoom(Number(one.dataset.zoom)));
  }
  for (const one of document.querySelectorAll('[data-move]')) {
    one.addEventListener('click', () => move(Number(one.dataset.move)));
  }
  place.addEventListener('wheel', function (event) {
    /* Without Ctrl the wheel scrolls the page, which a plot must not catch. */
    if (!event.ctrlKey) { return; }
    event.preventDefault();
    zoom(Math.pow(1.0015, event.deltaY), timeAt(event));
  }, { passive: false });
  place.addEventListener('pointerdown', function (event) {
    const held = timeAt(event);
    const follow = (moved) => {
      const shift = held - timeAt(moved);
      show(view[0] + shift, view[1] + shift);
    };
    const release = () => removeEventListener('pointermove', follow);
    addEventListener('pointermove', follow);
    addEventListener('pointerup', release, { once: true });
    addEventListener('pointercancel', release, { once: true });
  });
  const keys = { ArrowLeft: () => move(-0.25), ArrowRight: () => move(0.25),
    '+': () => zoom(0.5), '-': () => zoom(2), 0: () => show(0, traces.end) };
  place.addEventListener('keydown', function (event) {
    if (keys[event.key]) { event.preventDefault(); keys[event.key](); }
  });
  addEventListener('resize', function () {
    for (const one of Object.values(plots)) {
      one.setSize({ width: place.clientWidth, height: one.height });
    }
  });
  show(0, traces.end);
})();
