// What time it is in the replay. Whoever draws listens; nobody draws more often than the screen does.
export const SPEEDS = [0.25, 0.5, 1, 2, 5, 10];
const FRAME_MAX_S = 0.1; // a page that was hidden does not jump

export class Clock {
  constructor(start, end) {
    this.start = start;
    this.end = end;
    this.time = start;
    this.speed = 2;
    this.playing = false;
    this.listeners = [];
    this.asked = false;
    this.last = 0;
  }

  get label() {
    return this.playing ? "Pause" : "Play";
  }

  listen(listener) {
    this.listeners.push(listener);
  }

  seek(time) {
    this.time = Math.min(this.end, Math.max(this.start, time));
    this.changed();
  }

  step(seconds) {
    this.playing = false;
    this.seek(Math.round((this.time + seconds) * 10) / 10);
  }

  toggle() {
    this.playing = !this.playing;
    if (this.playing && this.time >= this.end) this.time = this.start;
    this.last = performance.now();
    this.changed();
  }

  // Everything is drawn again with the next frame.
  changed() {
    if (this.asked) return;
    this.asked = true;
    requestAnimationFrame((now) => this.frame(now));
  }

  frame(now) {
    this.asked = false;
    if (this.playing) {
      this.time += Math.min(FRAME_MAX_S, Math.max(0, (now - this.last) / 1000)) * this.speed;
      this.last = now;
      if (this.time >= this.end) {
        this.time = this.end;
        this.playing = false;
      }
    }
    for (const listener of this.listeners) listener(this.time);
    if (this.playing) this.changed();
  }
}
