//! The help text on sources.

/// Explains the values of `--source`.
pub(super) const HELP: &str = "\
Sources:
  v4l2:/dev/video0               a camera, by its device node
  v4l2:NAME                      a camera, by its stable name or its card's name (doorcam devices lists them)
  replay:DIR[,loop][,rate=max]   a recording, once or in a loop, at its own pace or as fast as possible
  simulate:SCENARIO[,seed=N][,once][,rate=max]
                                 a simulated doorway (doorcam simulate --list), in a loop or once";
