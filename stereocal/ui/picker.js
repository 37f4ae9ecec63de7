// A photograph to look at and to pick from: zoom, pan, marks, sub-pixel clicks.
// Image coordinates: pixel centres at integers, so that pixel i covers i - 0.5 to i + 0.5.

const DEEPEST = 1000 // CSS px per image px: a sigma of 0.005 px is then 5 px
const CLOSE_UP = 12 // of the buttons that go to a target
const STEP = 48 // of an arrow key, CSS px
const SIGMA_SHOWN = 2.5 // radius from which the circle of one sigma is drawn, CSS px
const HALO = "rgba(0, 0, 0, 0.75)"
const LENS = 75 // radius of the magnifier, CSS px
const LENS_SCALE = 5 // of the magnifier, over the photograph around it

const pickers = new WeakMap()
const views = (window.stereocalViews ??= new Map()) // by photograph: also of a page that was left

export default function (component) {
  const root = component.parentElement.querySelector(".picker")
  if (!pickers.has(root)) pickers.set(root, new Picker(root))
  const picker = pickers.get(root)
  picker.update(component.data, component.setTriggerValue)
  return () => picker.rest()
}

class Picker {
  constructor(root) {
    this.root = root
    this.canvas = root.querySelector("canvas")
    this.context = this.canvas.getContext("2d")
    this.readout = root.querySelector("output")
    this.pointers = new Map()
    this.fitted = true
    this.observer = new ResizeObserver(() => this.resize())
    const on = (name, act, options) => this.canvas.addEventListener(name, act, options)
    on("wheel", (event) => this.wheel(event), { passive: false })
    on("pointerdown", (event) => this.down(event))
    on("pointermove", (event) => this.move(event))
    on("pointerup", (event) => this.up(event))
    on("pointercancel", (event) => this.lost(event))
    on("pointerleave", () => { if (!this.pointers.size) this.look(null) })
    on("keydown", (event) => this.key(event))
    on("focus", () => this.draw())
    on("blur", () => this.draw())
    for (const button of root.querySelectorAll("button")) {
      button.addEventListener("click", () => this.press(button.dataset.act))
    }
  }

  update(data, send) {
    this.send = send
    this.canvas.setAttribute("aria-label", data.label)
    this.pending = null
    const before = this.data
    this.data = data
    for (const button of this.root.querySelectorAll(".target")) {
      const mark = data.marks.find((one) => one.letter === button.dataset.act)
      button.hidden = !data.targets
      button.disabled = !mark
      if (mark) button.style.setProperty("--mark", mark.colour)
    }
    // What was just named is clicked next: keys are no longer those of the field with its name.
    if (before && before.about !== data.about && document.activeElement?.matches("input")) {
      document.activeElement.blur()
    }
    this.observer.observe(this.canvas)
    if (before && before.id === data.id) return this.draw()
    // Of a film the view stays from frame to frame, else each photograph has its own.
    if (before && !data.targets && this.scale && !views.has(data.id)
      && before.width === data.width && before.height === data.height && !this.fitted) {
      views.set(data.id, { scale: this.scale, u: this.u, v: this.v })
    }
    // Another photograph: what stands on the screen must not take clicks for it.
    this.image = null
    delete this.canvas.dataset.ready
    this.canvas.style.aspectRatio = `${data.width} / ${data.height}`
    const image = new Image()
    image.onload = () => {
      if (this.data.id !== data.id) return
      this.image = image
      const view = views.get(data.id)
      this.fitted = !view
      if (view) Object.assign(this, view)
      this.resize()
      this.canvas.dataset.ready = data.id
    }
    image.src = data.source
  }

  rest() {
    this.observer.disconnect()
  }

  // The view: `scale` CSS px per image px, the image point (u, v) in the middle of the canvas.

  resize() {
    const { clientWidth: width, clientHeight: height } = this.canvas
    if (!width || !height || !this.data) return
    this.width = width
    this.height = height
    const ratio = window.devicePixelRatio || 1
    this.canvas.width = Math.round(width * ratio)
    this.canvas.height = Math.round(height * ratio)
    if (this.fitted || !this.scale) this.fit()
    this.draw()
  }

  get wholeScale() {
    return Math.min(this.width / this.data.width, this.height / this.data.height)
  }

  fit() {
    this.scale = this.wholeScale
    this.u = (this.data.width - 1) / 2
    this.v = (this.data.height - 1) / 2
    this.fitted = true
  }

  toImage(x, y) {
    return [this.u + (x - this.width / 2) / this.scale, this.v + (y - this.height / 2) / this.scale]
  }

  toScreen(u, v) {
    return [(u - this.u) * this.scale + this.width / 2, (v - this.v) * this.scale + this.height / 2]
  }

  show(scale, u, v) {
    const clip = (value, low, high) => Math.min(Math.max(value, low), high)
    this.scale = clip(scale, this.wholeScale, DEEPEST)
    this.fitted = this.scale <= this.wholeScale
    if (this.fitted) this.fit()
    else {
      this.u = clip(u, -0.5, this.data.width - 0.5)
      this.v = clip(v, -0.5, this.data.height - 0.5)
    }
    this.draw()
  }

  zoom(factor, x = this.width / 2, y = this.height / 2) {
    const [u, v] = this.toImage(x, y)
    const scale = Math.min(Math.max(this.scale * factor, this.wholeScale), DEEPEST)
    this.show(scale, u - (x - this.width / 2) / scale, v - (y - this.height / 2) / scale)
  }

  pan(dx, dy) {
    this.show(this.scale, this.u - dx / this.scale, this.v - dy / this.scale)
  }

  press(act) {
    const mark = this.data.targets && this.data.marks.find((one) => one.letter === act)
    if (act === "in") this.zoom(1.6)
    else if (act === "out") this.zoom(1 / 1.6)
    else if (mark) this.show(Math.max(CLOSE_UP, 4 * this.wholeScale), mark.u, mark.v)
    else if (act !== "A" && act !== "B") this.show(0, 0, 0)
  }

  pick(x, y, raw) {
    const [u, v] = this.toImage(x, y)
    const inside = u >= -0.5 && v >= -0.5 && u <= this.data.width - 0.5 && v <= this.data.height - 0.5
    if (!this.image || !inside || this.data.locked) return
    this.pending = [u, v]
    setTimeout(() => this.answered(), 2000) // a click that changes nothing has no other answer
    this.draw()
    this.send("picked", { id: this.data.id, u, v, raw })
  }

  answered() {
    this.pending = null
    this.draw()
  }

  tell(point) {
    this.readout.textContent = point
      ? `u ${point[0].toFixed(1)}  v ${point[1].toFixed(1)}  ${zoomText(this.scale)}`
      : zoomText(this.scale)
  }

  look(place) {
    this.over = place
    this.tell(place && this.toImage(...place))
    if (!this.data.targets) this.draw()
  }

  // Mouse, pen and fingers

  at(event) {
    // The box has fractions of a pixel, the drawing has none and is stretched to it.
    const box = this.canvas.getBoundingClientRect()
    return [
      (event.clientX - box.left) * this.width / box.width,
      (event.clientY - box.top) * this.height / box.height,
    ]
  }

  wheel(event) {
    event.preventDefault()
    const lines = event.deltaMode === 1 ? 30 : 1
    this.zoom(Math.exp(-0.002 * lines * event.deltaY), ...this.at(event))
  }

  down(event) {
    if (event.button) return
    this.canvas.setPointerCapture(event.pointerId)
    const place = this.at(event)
    this.pointers.set(event.pointerId, place)
    this.start = this.pointers.size === 1 ? place : null // two fingers never pick
    this.slack = event.pointerType === "mouse" ? 3 : 9
  }

  move(event) {
    const place = this.at(event)
    this.look(place)
    const before = this.pointers.get(event.pointerId)
    if (!before) return
    if (this.pointers.size === 2) this.pinch(event.pointerId, before, place)
    else if (this.start && Math.hypot(place[0] - this.start[0], place[1] - this.start[1]) <= this.slack) return
    else {
      this.start = null
      this.pan(place[0] - before[0], place[1] - before[1])
    }
    this.pointers.set(event.pointerId, place)
  }

  pinch(id, before, place) {
    const [[, other]] = [...this.pointers].filter(([one]) => one !== id)
    const apart = (point) => Math.max(Math.hypot(point[0] - other[0], point[1] - other[1]), 1)
    const middle = (point) => [(point[0] + other[0]) / 2, (point[1] + other[1]) / 2]
    const [from, to] = [middle(before), middle(place)]
    this.zoom(apart(place) / apart(before), ...from)
    this.pan(to[0] - from[0], to[1] - from[1])
  }

  up(event) {
    const known = this.pointers.delete(event.pointerId)
    if (known && this.start && !this.pointers.size) this.pick(...this.at(event), event.shiftKey)
    this.start = null
  }

  lost(event) {
    this.pointers.delete(event.pointerId)
    this.start = null
  }

  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return
    const step = event.shiftKey ? STEP / 12 : STEP
    const acts = {
      ArrowLeft: () => this.pan(step, 0), ArrowRight: () => this.pan(-step, 0),
      ArrowUp: () => this.pan(0, step), ArrowDown: () => this.pan(0, -step),
      "+": () => this.zoom(1.25), "=": () => this.zoom(1.25), "-": () => this.zoom(0.8),
      "0": () => this.press("fit"),
      ...(this.data.targets && { a: () => this.press("A"), b: () => this.press("B") }),
      Enter: () => this.pick(this.width / 2, this.height / 2, event.shiftKey),
    }
    if (!acts[event.key]) return
    event.preventDefault()
    event.stopPropagation()
    acts[event.key]()
    this.tell([this.u, this.v])
  }

  // Drawing

  draw() {
    if (!this.width || !this.scale) return
    const context = this.context
    const ratio = this.canvas.width / this.width
    context.setTransform(ratio, 0, 0, ratio, 0, 0)
    context.clearRect(0, 0, this.width, this.height)
    if (!this.image) return
    this.drawScene(ratio)
    if (this.pending) {
      const at = this.toScreen(...this.pending)
      this.stroke("#ffffff", 2, (path) => path.arc(...at, 9, 0, 2 * Math.PI))
    }
    if (this.canvas.matches(":focus-visible")) this.drawCrossHair()
    const view = { scale: this.scale, u: this.u, v: this.v }
    this.canvas.dataset.view = JSON.stringify(view)
    if (this.fitted) views.delete(this.data.id)
    else views.set(this.data.id, view)
    if (this.over && !this.data.targets) this.drawLens(ratio)
    this.tell(this.over && this.toImage(...this.over))
  }

  drawScene(ratio) {
    this.drawPhotograph(ratio)
    for (const line of this.data.lines) this.drawLine(line)
    for (const mark of this.data.marks) this.drawMark(mark)
  }

  // What is under the pointer, larger: in a corner away from it.
  drawLens(ratio) {
    const [x, y] = this.over
    const radius = Math.min(LENS, this.width / 5)
    const middle = [x < this.width / 2 ? this.width - radius - 8 : radius + 8, radius + 8]
    const now = { scale: this.scale, u: this.u, v: this.v }
    const [u, v] = this.toImage(x, y)
    const context = this.context
    context.save()
    const circle = new Path2D()
    circle.arc(...middle, radius, 0, 2 * Math.PI)
    context.clip(circle)
    context.clearRect(middle[0] - radius, middle[1] - radius, 2 * radius, 2 * radius)
    this.scale = Math.min(Math.max(this.scale, 0.4) * LENS_SCALE, DEEPEST)
    this.u = u + (this.width / 2 - middle[0]) / this.scale
    this.v = v + (this.height / 2 - middle[1]) / this.scale
    this.drawScene(ratio)
    Object.assign(this, now)
    context.restore()
    this.stroke("#ffffff", 1.5, (path) => path.addPath(circle))
    this.stroke("#ffffff", 1, (path) => ticks(path, ...middle, 6, 16))
  }

  drawLine(line) {
    this.stroke(line.colour, 1.5, (path) => {
      line.points.forEach(([u, v], k) => path[k ? "lineTo" : "moveTo"](...this.toScreen(u, v)))
    })
  }

  drawPhotograph(ratio) {
    // Only the pixels in view, whole ones: the browser's numbers are too coarse for all of them.
    const [left, top] = this.toImage(0, 0).map((edge) => Math.max(Math.floor(edge + 0.5), 0))
    const corner = this.toImage(this.width, this.height)
    const right = Math.min(Math.ceil(corner[0] + 0.5), this.data.width)
    const bottom = Math.min(Math.ceil(corner[1] + 0.5), this.data.height)
    if (right <= left || bottom <= top) return
    this.context.imageSmoothingEnabled = this.scale * ratio < 2
    this.context.imageSmoothingQuality = "high"
    const size = this.image.naturalWidth / this.data.width // a very large one comes reduced
    this.context.drawImage(
      this.image, left * size, top * size, (right - left) * size, (bottom - top) * size,
      ...this.toScreen(left - 0.5, top - 0.5),
      (right - left) * this.scale, (bottom - top) * this.scale,
    )
  }

  drawMark(mark) {
    const [x, y] = this.toScreen(mark.u, mark.v)
    const circle = (mark.sigma || 0) * this.scale
    // The shape leaves the corner itself, and the circle of its sigma, in view.
    const reach = mark.shape === "cross" ? 9 : Math.max(13, circle + 6)
    this.context.setLineDash(mark.shape === "dashed" ? [5, 4] : [])
    this.stroke(mark.colour, 2, (path) => {
      if (mark.shape === "cross") ticks(path, x, y, 3, 12)
      else if (mark.shape === "diamond") {
        path.moveTo(x, y - reach * 1.2)
        path.lineTo(x + reach * 1.2, y)
        path.lineTo(x, y + reach * 1.2)
        path.lineTo(x - reach * 1.2, y)
        path.closePath()
      } else {
        path.moveTo(x + reach, y)
        path.arc(x, y, reach, 0, 2 * Math.PI)
      }
    })
    this.context.setLineDash([])
    if (this.scale >= 3 && this.data.targets) this.stroke(mark.colour, 1.5, (path) => ticks(path, x, y, circle + 2, circle + 6))
    if (circle >= SIGMA_SHOWN) {
      this.stroke("#ffffff", 1.5, (path) => path.arc(x, y, circle, 0, 2 * Math.PI))
    }
    const context = this.context
    context.font = "bold 17px sans-serif"
    context.textBaseline = "middle"
    context.lineWidth = 4
    context.lineJoin = "round"
    context.strokeStyle = HALO
    // On the side away from the other mark, and inside the picture.
    const room = context.measureText(mark.letter).width + reach + 5
    const other = this.data.marks.some((other) => other.u > mark.u)
    const left = x > room && (other || x + room > this.width)
    context.textAlign = left ? "right" : "left"
    const beside = left ? x - reach - 5 : x + reach + 5
    context.strokeText(mark.letter, beside, y - reach)
    context.fillStyle = mark.colour
    context.fillText(mark.letter, beside, y - reach)
  }

  drawCrossHair() {
    this.stroke("#ffffff", 1.5, (path) => ticks(path, this.width / 2, this.height / 2, 5, 26))
  }

  stroke(colour, width, draw) {
    const path = new Path2D()
    draw(path)
    for (const [style, extra] of [[HALO, 2.5], [colour, 0]]) {
      this.context.strokeStyle = style
      this.context.lineWidth = width + extra
      this.context.stroke(path)
    }
  }
}

// Four lines around a place that leave it open.
function ticks(path, x, y, inner, outer) {
  for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
    path.moveTo(x + inner * dx, y + inner * dy)
    path.lineTo(x + outer * dx, y + outer * dy)
  }
}

function zoomText(scale) {
  return scale >= 1 ? `${scale.toFixed(1)} ×` : `${Math.round(100 * scale)} %`
}
