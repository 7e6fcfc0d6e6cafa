//! What the help says of sources.

/// What clap's help says of `--source`.
pub(super) const HELP: &str = "\
Sources:
  v4l2:/dev/video0               a camera, by its node
  v4l2:NAME                      a camera, by its stable name or its card's name (doorcam devices lists them)
  replay:DIR[,loop][,rate=max]   a recording: at its own pace or as fast as it goes, once or for ever
  simulate:SCENARIO[,seed=N][,once][,rate=max]
                                 a simulated doorway (doorcam simulate --list), round after round or once";
