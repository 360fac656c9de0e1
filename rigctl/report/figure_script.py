"""The script of a report's page: values under the pointer, and a closer look; without it every figure is complete."""

from __future__ import annotations

SCRIPT = """
(() => {
  document.documentElement.classList.add('scripted');
  const shown = document.createElement('div');
  shown.className = 'reading';
  shown.hidden = true;
  document.body.append(shown);

  // The value at a share of an axis: the reverse of rigctl.report.chart.scale.
  const unscaled = (kind, upTo, s) => {
    if (kind === 'log') return 10 ** s;
    if (kind !== 'symlog') return s;
    const size = Math.abs(s), added = 10 / 9;
    return Math.sign(s) * upTo * (size <= added ? size / added : 10 ** (size - added));
  };
  const scaled = (kind, upTo, v) => {
    if (kind === 'log') return Math.log10(v);
    if (kind !== 'symlog') return v;
    const size = Math.abs(v) / upTo, added = 10 / 9;
    return Math.sign(v) * (size <= 1 ? size * added : added + Math.log10(size));
  };
  const valueAt = (axis, share) => {
    const [kind, low, high, upTo] = axis.split(' ').map((word, place) => place ? Number(word) : word);
    const from = scaled(kind, upTo, low), to = scaled(kind, upTo, high);
    return unscaled(kind, upTo, from + share * (to - from)).toPrecision(4).replace('-', '\\u2212');
  };

  for (const svg of document.querySelectorAll('figure svg')) {
    const whole = svg.getAttribute('viewBox');
    let start = null, drawn = null;
    const point = event => new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
    const hide = () => { shown.hidden = true; };
    svg.addEventListener('pointermove', event => {
      const panel = event.target.closest('.panel');
      if (panel) {
        const frame = panel.querySelector('.frame').getBoundingClientRect();
        const x = valueAt(panel.dataset.x, (event.clientX - frame.left) / frame.width);
        const y = valueAt(panel.dataset.y, (frame.bottom - event.clientY) / frame.height);
        shown.textContent = x + ', ' + y;
        shown.style.left = Math.min(event.clientX + 14, innerWidth - 170) + 'px';
        shown.style.top = event.clientY + 14 + 'px';
      }
      shown.hidden = !panel;
      if (start) {
        const end = point(event);
        drawn.setAttribute('x', Math.min(start.x, end.x));
        drawn.setAttribute('y', Math.min(start.y, end.y));
        drawn.setAttribute('width', Math.abs(end.x - start.x));
        drawn.setAttribute('height', Math.abs(end.y - start.y));
      }
    });
    svg.addEventListener('pointerleave', hide);
    svg.addEventListener('pointerdown', event => {
      if (event.pointerType === 'touch' || event.button || !event.target.closest('.panel')) return;
      start = point(event);
      drawn = document.createElementNS('http://www.w3.org/2000/svg', 'rect');
      drawn.setAttribute('class', 'chosen');
      svg.append(drawn);
      svg.setPointerCapture(event.pointerId);
      event.preventDefault();
    });
    svg.addEventListener('pointerup', () => {
      if (!start) return;
      const [x, y, wide, high] = ['x', 'y', 'width', 'height'].map(name => Number(drawn.getAttribute(name)));
      drawn.remove();
      start = null;
      if (wide > 4 && high > 4) svg.setAttribute('viewBox', [x, y, wide, high].join(' '));
    });
    svg.addEventListener('dblclick', () => svg.setAttribute('viewBox', whole));
  }
})();
"""

STYLE = """
.reading { position: fixed; padding: 0.1rem 0.4rem; font-size: 0.8rem; pointer-events: none;
           color: var(--ink); background: var(--mark); border: 1px solid var(--rule); }
.chosen { fill: #0072B2; opacity: 0.2; } svg .panel { cursor: crosshair; } .hint { display: none; }
.scripted .hint { display: block; }
@media print { .reading, .scripted .hint { display: none; } }
"""

HINT = "In figures: point at a marker for its value; draw a box to look closer, click twice to come back."
