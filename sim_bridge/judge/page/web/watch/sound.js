// A tone that repeats while a grave alarm stands that nobody has silenced. Browsers allow it after a touch only.
const EVERY_MS = 1600;

export class Sound {
  constructor() {
    this.context = null;
    this.heard = 0; // how often it sounded
    setInterval(() => this.wanted && this.beep(), EVERY_MS);
  }

  get on() {
    return this.context !== null;
  }

  turn() {
    if (this.context) {
      this.context.close();
      this.context = null;
    } else {
      this.context = new AudioContext();
      this.tone(880, 0, 0.12); // so that it is known how loud it is
    }
  }

  ring(wanted) {
    if (wanted && !this.wanted) this.beep();
    this.wanted = wanted;
  }

  beep() {
    this.heard += 1;
    if (navigator.userActivation?.hasBeenActive) navigator.vibrate?.([250, 120, 250]);
    if (!this.context) return;
    this.tone(988, 0, 0.25);
    this.tone(740, 0.3, 0.35);
  }

  tone(hz, after, lasts) {
    const { context } = this;
    const [source, volume] = [context.createOscillator(), context.createGain()];
    const start = context.currentTime + after;
    source.type = "square";
    source.frequency.value = hz;
    volume.gain.setValueAtTime(0.25, start);
    volume.gain.exponentialRampToValueAtTime(0.001, start + lasts);
    source.connect(volume).connect(context.destination);
    source.start(start);
    source.stop(start + lasts);
  }
}
