/** Seconds by a clock that nobody sets back. It counts from an arbitrary moment, so only differences mean something. */
export const nowS = () => performance.now() / 1000;
