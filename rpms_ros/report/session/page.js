(function () {
  'use strict';
  const traces = JSON.parse(document.getElementById('traces').textContent);
  const canvas = document.getElementById('force-canvas');
  const shown = document.getElementById('shown');
  const GREY = '#a0a0a0', BLACK = '#000', FAINT = '#6e6e6e', GRID = '#dedede';
  const LEFT = 58, RIGHT = 10, TOP = 8, GAP = 26, BOTTOM = 34, SHARE = 0.7;

  function numbers(text) {
    const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
    return new Float32Array(bytes.buffer);
  }

  const windows = traces.windows.map(function (window) {
    const time = Float64Array.from(numbers(window.time), (value) => value + window.start);
    const measured = numbers(window.measured), modelled = numbers(window.modelled);
    const residual = measured.map((value, index) => value - modelled[index]);
    return { label: window.label, time, measured: [measured, measured],
      modelled: [modelled, modelled], residual: [residual, residual] };
  });
  const envelope = traces.envelope && {
    time: Float64Array.from(numbers(traces.envelope.time)),
    measured: traces.envelope.measured.map(numbers),
    modelled: traces.envelope.modelled.map(numbers),
    residual: traces.envelope.residual.map(numbers),
  };
  const end = traces.end;
  let view = [0, end];

  /* Every sample where the whole view lies in a window that has them, else the envelope. */
  function source() {
    const inside = windows.find((window) =>
      window.time[0] <= view[0] + 1e-6 && window.time[window.time.length - 1] >= view[1] - 1e-6);
    return inside || envelope || windows[0];
  }

  function firstAtOrAfter(time, value) {
    let low = 0, high = time.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (time[middle] < value) { low = middle + 1; } else { high = middle; }
    }
    return low;
  }

  function slice(time) {
    return [Math.max(0, firstAtOrAfter(time, view[0]) - 1),
      Math.min(time.length, firstAtOrAfter(time, view[1]) + 1)];
  }

  function extent(series, first, last) {
    let low = Infinity, high = -Infinity;
    for (const [below, above] of series) {
      for (let index = first; index < last; index += 1) {
        low = Math.min(low, below[index]);
        high = Math.max(high, above[index]);
      }
    }
    if (!(low < high)) { low = (low || 0) - 1; high = low + 2; }
    const margin = 0.06 * (high - low);
    return [low - margin, high + margin];
  }

  function ticks(low, high, most) {
    const raw = (high - low) / most, power = Math.pow(10, Math.floor(Math.log10(raw)));
    const step = [1, 2, 5, 10].find((factor) => factor * power >= raw) * power;
    const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
    const found = [];
    for (let k = Math.ceil(low / step); k * step <= high; k += 1) {
      found.push([k * step, (k * step).toFixed(digits)]);
    }
    return found;
  }

  /* A line, or one bar a pixel column where samples are closer than that. */
  function trace(pen, time, pair, range, x, y, colour, width) {
    const [first, last] = range, columns = Math.abs(x(view[1]) - x(view[0]));
    pen.strokeStyle = colour;
    pen.lineWidth = width;
    pen.lineJoin = 'round';
    pen.beginPath();
    if (pair[0] === pair[1] && last - first <= 3 * columns) {
      for (let index = first; index < last; index += 1) {
        pen.lineTo(x(time[index]), y(pair[0][index]));
      }
    } else {
      let column = NaN, low = 0, high = 0;
      for (let index = first; index <= last; index += 1) {
        const here = index < last ? Math.round(x(time[index])) : NaN;
        if (here === column) {
          low = Math.min(low, pair[0][index]);
          high = Math.max(high, pair[1][index]);
          continue;
        }
        if (!Number.isNaN(column)) {
          pen.lineTo(column, y(low));
          pen.lineTo(column, y(high));
        }
        if (index < last) { column = here; low = pair[0][index]; high = pair[1][index]; }
      }
    }
    pen.stroke();
  }

  function panel(pen, box, label, limits, x) {
    const y = (value) => box[1] - (value - limits[0]) / (limits[1] - limits[0]) * (box[1] - box[0]);
    pen.lineWidth = 1;
    pen.strokeStyle = GRID;
    pen.fillStyle = FAINT;
    pen.textAlign = 'right';
    pen.textBaseline = 'middle';
    for (const [value, text] of ticks(limits[0], limits[1], (box[1] - box[0]) / 40)) {
      pen.beginPath();
      pen.moveTo(x(view[0]), y(value));
      pen.lineTo(x(view[1]), y(value));
      pen.stroke();
      pen.fillText(text, LEFT - 6, y(value));
    }
    pen.save();
    pen.translate(12, (box[0] + box[1]) / 2);
    pen.rotate(-Math.PI / 2);
    pen.textAlign = 'center';
    pen.fillStyle = BLACK;
    pen.fillText(label, 0, 0);
    pen.restore();
    return y;
  }

  function draw() {
    const ratio = window.devicePixelRatio || 1;
    const width = canvas.clientWidth, height = canvas.clientHeight;
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
    const pen = canvas.getContext('2d');
    pen.scale(ratio, ratio);
    pen.font = '12px system-ui, "Liberation Sans", Arial, sans-serif';
    const x = (t) => LEFT + (t - view[0]) / (view[1] - view[0]) * (width - LEFT - RIGHT);
    const split = TOP + SHARE * (height - TOP - GAP - BOTTOM);
    const boxes = [[TOP, split], [split + GAP, height - BOTTOM]];
    const data = source(), range = slice(data.time);
    const force = panel(pen, boxes[0], 'force / N',
      extent([data.measured, data.modelled], range[0], range[1]), x);
    const rest = panel(pen, boxes[1], 'residual / N',
      extent([data.residual], range[0], range[1]), x);
    pen.textAlign = 'center';
    pen.textBaseline = 'top';
    pen.fillStyle = FAINT;
    for (const [value, text] of ticks(view[0], view[1], width / 90)) {
      pen.fillText(text, x(value), height - BOTTOM + 5);
    }
    pen.fillStyle = BLACK;
    pen.fillText('time / s', LEFT + (width - LEFT - RIGHT) / 2, height - BOTTOM + 19);
    pen.save();
    pen.beginPath();
    pen.rect(LEFT, 0, width - LEFT - RIGHT, height);
    pen.clip();
    trace(pen, data.time, data.measured, range, x, force, GREY, 3);
    trace(pen, data.time, data.modelled, range, x, force, BLACK, 1);
    trace(pen, data.time, data.residual, range, x, rest, BLACK, 0.8);
    pen.restore();
    const how = data === envelope ? 'envelope' : 'every sample';
    shown.textContent = `${view[0].toFixed(3)} to ${view[1].toFixed(3)} s, ${how}`;
    canvas.dataset.view = view.join(' ');
  }

  function show(from, to) {
    const length = Math.min(end, Math.max(1e-3, to - from));
    const start = Math.min(Math.max(0, from), end - length);
    view = [start, start + length];
    draw();
  }

  function zoom(factor, around) {
    const centre = around === undefined ? (view[0] + view[1]) / 2 : around;
    show(centre - (centre - view[0]) * factor, centre + (view[1] - centre) * factor);
  }

  function move(share) {
    const step = share * (view[1] - view[0]);
    show(view[0] + step, view[1] + step);
  }

  function timeAt(event) {
    const box = canvas.getBoundingClientRect();
    const share = (event.clientX - box.left - LEFT) / (box.width - LEFT - RIGHT);
    return view[0] + share * (view[1] - view[0]);
  }

  function button(label, from, to) {
    const element = document.createElement('button');
    element.type = 'button';
    element.textContent = label;
    element.addEventListener('click', () => show(from, to));
    document.getElementById('ranges').append(element);
  }

  button('all', 0, end);
  if (envelope) {
    for (const window of windows) {
      button(window.label, window.time[0], window.time[window.time.length - 1]);
    }
  } else {
    button('last 2 s', end - 2, end);
  }
  for (const element of document.querySelectorAll('[data-zoom]')) {
    element.addEventListener('click', () => zoom(Number(element.dataset.zoom)));
  }
  for (const element of document.querySelectorAll('[data-move]')) {
    element.addEventListener('click', () => move(Number(element.dataset.move)));
  }
  canvas.addEventListener('wheel', function (event) {
    event.preventDefault();
    zoom(Math.pow(1.0015, event.deltaY), timeAt(event));
  }, { passive: false });
  canvas.addEventListener('pointerdown', function (event) {
    const held = timeAt(event);
    canvas.setPointerCapture(event.pointerId);
    const follow = (moved) => {
      const shift = held - timeAt(moved);
      show(view[0] + shift, view[1] + shift);
    };
    canvas.addEventListener('pointermove', follow);
    const release = () => canvas.removeEventListener('pointermove', follow);
    canvas.addEventListener('pointerup', release, { once: true });
    canvas.addEventListener('pointercancel', release, { once: true });
  });
  const keys = { ArrowLeft: () => move(-0.25), ArrowRight: () => move(0.25),
    '+': () => zoom(0.5), '-': () => zoom(2), 0: () => show(0, end) };
  canvas.addEventListener('keydown', function (event) {
    if (keys[event.key]) { event.preventDefault(); keys[event.key](); }
  });
  document.getElementById('viewer').hidden = false;
  document.getElementById('still').hidden = true;
  window.addEventListener('resize', draw);
  show(0, end);
})();
