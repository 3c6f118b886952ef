/* Copyright 2026 rpms_ros contributors */
/* SPDX-License-Identifier: Apache-2.0 */
/* The plots: uPlot draws; what is here keeps half a minute of force and says which part is shown. */
const plots = (function () {
  'use strict';
  const KEPT = 6000;
  const FORCE = 260, PULSES = 130, EFFORT = 170, CURVE = 240;
  const element = (id) => document.getElementById(id);
  const colour = (name) => () => getComputedStyle(document.documentElement)
    .getPropertyValue(name).trim();
  const force = { epoch: -1, first: 0, width: 0.005, time: [], low: [], high: [], modelled: [] };
  const pulses = { time: [], intensity: [] };
  const effort = { time: [], lower: [], upper: [], value: [] };
  // Frames come ten times a second; in between the plot moves on with the clock of the screen, as
  // far behind the newest bin as a frame may be late [s].
  const LAG = 0.15, PAUSE = 0.5, FAR = 1;
  let marks = [], span = 10, edge = 0, moved = 0, fresh = true;

  const end = () => force.time.length ? force.time[force.time.length - 1] : 0;
  const inView = () => [Math.max(0, edge - span), Math.max(span, edge)];
  function moveTo(now) {
    const passed = Math.max(now - moved, 0), behind = end() - edge, before = edge;
    moved = now;
    // after a pause or a jump of the clock there is nothing to glide over
    edge = passed > PAUSE || behind < 0 || behind > FAR ? end()
      : Math.min(end(), edge + passed * (1 + 2 * (behind - LAG)));
    return edge !== before;
  }
  const axis = (label, size) => ({ label, size, labelSize: 18, labelGap: 0, stroke: colour('--soft'),
    grid: { stroke: colour('--line'), width: 1 }, ticks: { stroke: colour('--line') },
    font: '12px system-ui, sans-serif', labelFont: '12px system-ui, sans-serif' });
  const line = (label, stroke, width) => ({ label, stroke: colour(stroke), width,
    points: { show: false }, spanGaps: false, pxAlign: 0 });

  function make(id, height, xLabel, yLabel, scales, series, bands, hooks) {
    const place = element(id);
    return new uPlot({ width: Math.max(place.clientWidth, 200), height, scales, series, bands, hooks,
      axes: [axis(xLabel, 34), axis(yLabel, 56)], legend: { show: false },
      cursor: { show: false } }, series.map(() => []), place);
  }
  function stick(u, x, y0, y1, stroke, width) {
    const c = u.ctx, at = Math.round(u.valToPos(x, 'x', true));
    if (at < u.bbox.left || at > u.bbox.left + u.bbox.width) { return null; }
    c.save();
    c.strokeStyle = colour(stroke)();
    c.lineWidth = width * devicePixelRatio;
    c.beginPath(); c.moveTo(at, y0); c.lineTo(at, y1); c.stroke();
    c.restore();
    return at;
  }
  function drawMarks(u) {
    for (const [kind, time] of marks) {
      if (time === null) { continue; }
      const at = stick(u, time, u.bbox.top, u.bbox.top + u.bbox.height, '--change', 2);
      if (at === null) { continue; }
      u.ctx.save();
      u.ctx.fillStyle = colour('--change')();
      u.ctx.font = `${12 * devicePixelRatio}px system-ui, sans-serif`;
      u.ctx.textAlign = 'left';
      u.ctx.textBaseline = 'top';
      u.ctx.fillText(kind, at + 4 * devicePixelRatio, u.bbox.top);
      u.ctx.restore();
    }
  }
  function drawPulses(u) {
    const from = inView()[0], bottom = u.valToPos(0, 'y', true);
    for (let i = pulses.time.length - 1; i >= 0 && pulses.time[i] >= from; i -= 1) {
      stick(u, pulses.time[i], bottom, u.valToPos(pulses.intensity[i], 'y', true), '--ink', 2);
    }
  }
  // the noise of a muscle at rest does not fill the plot; with a curve its force is the measure
  let least = 1;
  const roomy = { range: (u, low, high) => {
    if (low === null) { return [0, least]; }
    const more = Math.max(0, least - (high - low)) / 2;
    return uPlot.rangeNum(low - more, high + more, 0.1, true);
  } };
  const x = { time: false, range: () => inView() };
  const banded = [{ series: [2, 1], fill: colour('--band') }];
  const made = {
    force: make('force-plot', FORCE, '', 'force / N', { x, y: roomy },
    // the measured force is drawn over the modelled, which is wider
    [{}, line('modelled', '--wide', 5), line('low', '--measured', 1.25),
      line('high', '--measured', 1.25)], [{ series: [3, 2], fill: colour('--spread') }], { draw: [drawMarks] }),
    pulses: make('pulse-plot', PULSES, 'time / s', 'intensity', { x, y: { range: [0, 1] } },
      [{}, { show: true, points: { show: false }, stroke: 'transparent' }], [], { draw: [drawPulses] }),
    effort: make('effort-plot', EFFORT, 'time / s', 'force / N', { x, y: roomy },
      [{}, line('lower', '--change', 0.5), line('upper', '--change', 0.5),
        line('value', '--change', 2)], [{ series: [2, 1], fill: colour('--changeband') }], { draw: [drawMarks] }),
    curve: make('curve-plot', CURVE, 'intensity', 'force / N',
      { x: { time: false, range: [0, 1] }, y: roomy }, [{}, line('lower', '--modelled', 0.5),
        line('upper', '--modelled', 0.5), line('curve', '--modelled', 2)], banded, {}),
    response: make('response-plot', CURVE, 'time after the pulse / s', 'force / N',
      { x: { time: false } }, [{}, line('lower', '--modelled', 0.5),
        line('upper', '--modelled', 0.5), line('response', '--modelled', 2)], banded, {}),
  };

  function clear() {
    for (const name of ['time', 'low', 'high', 'modelled']) { force[name] = []; }
    pulses.time = []; pulses.intensity = [];
    for (const name of Object.keys(effort)) { effort[name] = []; }
  }
  function addForce(part) {
    fresh = true;
    const gap = part.first - force.first - force.time.length;
    if (part.epoch !== force.epoch || gap !== 0) {
      clear();
      force.first = part.first;
    }
    force.epoch = part.epoch; force.width = part.width;
    const start = force.first + force.time.length;
    for (let i = 0; i < part.low.length; i += 1) { force.time.push((start + i) * part.width); }
    for (const name of ['low', 'high', 'modelled']) { force[name].push(...part[name]); }
    const over = force.time.length - KEPT;
    if (over > 0) {
      force.first += over;
      for (const name of ['time', 'low', 'high', 'modelled']) { force[name].splice(0, over); }
    }
  }
  function addPulses(part) {
    for (const [time, intensity] of part) {
      pulses.time.push(time); pulses.intensity.push(intensity);
    }
    forget(pulses);
  }
  /* Drops what is older than the force that is kept, all of it where nothing is newer. */
  function forget(course) {
    const old = course.time.findIndex((time) => time >= end() - KEPT * force.width);
    const count = Math.max(old < 0 ? course.time.length : old, course.time.length - KEPT);
    for (const values of Object.values(course)) { values.splice(0, count); }
  }
  /* The band is that of 95 %: twice the standard deviation, nearly. */
  function addEffort(part) {
    for (const [time, value, deviation] of part) {
      if (effort.time.length && time <= effort.time[effort.time.length - 1]) {
        for (const name of Object.keys(effort)) { effort[name] = []; }
      }
      effort.time.push(time); effort.value.push(value);
      effort.lower.push(value - 1.96 * deviation); effort.upper.push(value + 1.96 * deviation);
    }
    forget(effort);
    if (element('effort').hidden && effort.time.length) {
      element('effort').hidden = false;
      resize();
    }
  }
  const visible = (name) => {
    const start = Math.max(0, force.time.length - Math.ceil((span + FAR) / force.width) - 1);
    return force[name].slice(start);
  };
  function drawForce(now) {
    if (!moveTo(now) && !fresh) { return; }
    fresh = false;
    made.force.setData(['time', 'modelled', 'low', 'high'].map(visible));
    made.pulses.setData([[inView()[0], inView()[1]], [0, 0]]);
    const from = Math.max(0, effort.time.findIndex((time) => time >= inView()[0]) - 1);
    made.effort.setData(['time', 'lower', 'upper', 'value'].map((name) => effort[name].slice(from)));
  }
  const none = (part) => part.along.map(() => null);
  function drawCurve(name, part) {
    if (name === 'curve') { least = part ? 0.2 * Math.max(...part.force) || 1 : 1; }
    made[name].setData(part
      ? [part.along, part.lower || none(part), part.upper || none(part), part.force]
      : [[], [], [], []]);
  }
  function resize() {
    for (const one of Object.values(made)) {
      const width = one.root.parentElement.clientWidth;
      if (width && width !== one.width) { one.setSize({ width, height: one.height }); }
    }
  }
  function unit(name) {
    const label = `${name === 'N' ? 'force' : 'torque'} / ${name}`;
    for (const one of [made.force, made.effort, made.curve, made.response]) {
      one.axes[1].label = label;
    }
  }
  const newest = (name) => {
    for (let i = force[name].length - 1; i >= 0; i -= 1) {
      if (force[name][i] !== null) { return force[name][i]; }
    }
    return null;
  };
  addEventListener('resize', resize);
  matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => {
    for (const one of Object.values(made)) { one.redraw(false, true); }
  });
  return { addForce, addPulses, addEffort, drawForce, drawCurve, newest, resize, unit, force, pulses,
    effort, made,
    edge: () => edge, mark: (list) => { marks = list; fresh = true; },
    show: (seconds) => { span = seconds; fresh = true; } };
})();
