// The objects the daemon sends, as JSDoc types for the editor and for `tsc --checkJs`.
// Nothing imports this file at run time.

/** @typedef {[number, number]} Point  x, y in metres, door frame */
/** @typedef {[number, number, number]} Rgb  linear light change; negative is darker than the background */

/** @typedef {"unified" | "left" | "right"} Layer */
/** @typedef {"both" | "brighter" | "darker"} Signs */
/** @typedef {"measured" | "shrunk"} Brightness */

/**
 * @typedef {object} Geometry
 * @property {{ width_m: number, wall_thickness_m: number, height_m: number | null, leaf?: Leaf }} doorway
 * @property {{ half_width_m: number, depth_m: number }} room  what the map covers
 * @property {{ half_width_m: number, depth_m: number }} [searched]  where people are looked for
 * @property {{ fov_m: number, pixels: number }} patch
 * @property {[Point, Point][]} facets
 * @property {boolean[]} foreground
 * @property {number} calibration  revision it was made from; an update with another has its places elsewhere
 * @property {Zone[]} [zones]
 * @property {number} [zones_revision]  goes up with every change of the zones
 */

/** @typedef {{ hinge: "left" | "right", angle_deg: number, width_m: number }} Leaf  the door, open into the room: 0 would be closed, 90 is straight into it */
/** @typedef {{ id?: string, name: string, polygon_m: Point[] }} Zone  the id is the daemon's: a zone that is sent back with it stays the same */
/** @typedef {{ origin: "config" | "saved" | "run", zones: (Zone & { people: number, tracks: number[] })[] }} ZonesDocument */
/** @typedef {{ name: string, people: number, tracks: number[] }} Occupancy  who is in a zone */

/**
 * @typedef {object} LitFacet
 * @property {number} index
 * @property {Rgb} left
 * @property {Rgb} right
 * @property {Rgb} unified
 * @property {number} refit  times this, the light is as bright as measured
 */

/**
 * @typedef {object} Track
 * @property {number} id
 * @property {"tentative" | "confirmed" | "coasting"} state
 * @property {number} x_m
 * @property {number} y_m
 * @property {number} vx_m_s
 * @property {number} vy_m_s
 * @property {[[number, number], [number, number]]} covariance_m2
 * @property {Rgb} rgb
 * @property {number} age_s
 */

/** @typedef {"learning" | "watching" | "relearning" | "stale" | "obstructed" | "misaligned"} WatchState */

/** @typedef {{ state: "clear" | "partial" | "blocked", used: number }} PatchView  how much of a patch shows the floor: the share of its pixels that is used */

/**
 * @typedef {object} Update
 * @property {number} version
 * @property {number} sequence
 * @property {string} time
 * @property {number | null} frame
 * @property {WatchState} state
 * @property {{ lambda: number, objective: number, data: number, penalty: number, bound: number,
 *              iterations: number, warm: boolean }} solution
 * @property {string} model
 * @property {{ left: PatchView, right: PatchView }} [view]
 * @property {Crossings} [crossings]  with the first message of a socket and when they have changed
 * @property {{ left: Rgb, right: Rgb }} illumination
 * @property {{ left: Rgb, right: Rgb } | null} gain
 * @property {LitFacet[]} facets
 * @property {Track[]} tracks
 * @property {Occupancy[]} [zones]  left out where there are none
 * @property {Record<string, number>} timing_ms
 * @property {number} calibration  revision of the calibration it was made with
 */

/** @typedef {"opening" | "streaming" | "stalled" | "lost" | "backing-off" | "ended" | "failed"} SourceState */

/**
 * What a camera really does, read back from it.
 * @typedef {object} Granted
 * @property {string} node
 * @property {string} card
 * @property {string} format
 * @property {[number, number]} size
 * @property {number} fps
 * @property {string[]} mismatches  each a line for people: what was asked for and what the camera has
 */

/**
 * @typedef {object} Source
 * @property {string} spec
 * @property {string} kind
 * @property {SourceState} state
 * @property {string | null} notes
 * @property {number | null} fps
 * @property {string | null} error
 * @property {Granted | null} granted
 */

/** @typedef {{ state: "connecting" | "connected", broker: string, topic: string, error: string | null, warning?: string | null }} Broker */
/** @typedef {{ url: string, waiting: number, delivered: number, dead: number, error: string | null }} Webhook */

/**
 * Whether doorcam is watching, and if not, why.
 * @typedef {object} Watching
 * @property {boolean} watching
 * @property {string | null} reason
 * @property {string} since
 * @property {string | null} until
 */

/**
 * How the camera has moved since it was calibrated.
 * @typedef {object} CameraMoved
 * @property {number | null} dx_px  of the picture's middle, to the right; these are null if nothing is as it was
 * @property {number | null} dy_px  down
 * @property {number | null} rotation_deg  clockwise
 * @property {number | null} shift_px  the farthest that any part of the patches has moved
 * @property {string} since
 * @property {boolean} corrected  the calibration has followed
 */

/**
 * @typedef {object} Status
 * @property {string} version
 * @property {WatchState} state
 * @property {Watching} [watching]
 * @property {string} time  the daemon's clock
 * @property {number} uptime_s
 * @property {string | null} model  null before there is a calibration
 * @property {string | null} preset
 * @property {number} lambda
 * @property {Source} source
 * @property {{ captured: number, solved: number, dropped: number, skipped: number, lost: number, failed?: number,
 *              last_skipped: string | null }} frames
 * @property {{ captured: number, solved: number }} rate_hz
 * @property {{ sequence: number, age_s: number } | null} last_update
 * @property {number} clients
 * @property {number} zones_revision  goes up with every change of the zones
 * @property {Crossings} [crossings]
 * @property {{ state: "stored" | "memory", reason: string | null, file: string | null, bytes: number, lost: number }} history
 * @property {{ mqtt: Broker | null, webhooks: Webhook[] }} publish  who is told of what happens
 * @property {RecordingStatus | null} recording  under way, or the last one
 * @property {boolean} calibrated  false: a camera of which nobody has said yet where the door is
 * @property {CameraMoved | null} [camera_moved]  null if it has not
 * @property {number} calibration_revision  goes up with every saved calibration
 * @property {{ frames: number, age_s: number | null, progress: number | null } | null} background  progress: while it is learned
 */

/**
 * The least error with which one frame can locate a person, over the room.
 * @typedef {object} Uncertainty
 * @property {number[]} x_m  middles of the cells
 * @property {number[]} y_m
 * @property {(number | null)[][]} error_m  a row for each y; null where the pixels tell nothing
 * @property {number} threshold_m  above it, nobody is observable
 * @property {number} calibration  revision it was made for
 */

/**
 * @typedef {object} RoomEvent
 * @property {number} sequence
 * @property {"enter" | "exit" | "dwell" | "zone_enter" | "zone_exit" | "cross_in" | "cross_out" | "cross_back" | "camera_moved"} kind
 * @property {string} time
 * @property {number} track
 * @property {number} x_m
 * @property {number} y_m
 * @property {string | null} zone
 * @property {"door" | null} through  what somebody left through, if that was seen
 * @property {"door" | "entrance" | "unseen" | "merged" | null} reason  of an exit
 * @property {number | null} speed_m_s  across the threshold
 */

/**
 * Who walked through the doorway.
 * @typedef {object} Crossings
 * @property {boolean} available  they are seen and counted now
 * @property {string | null} reason  why not
 * @property {number} inside  an estimate
 * @property {string} since  the midnight since which they are counted
 * @property {number} in
 * @property {number} out
 * @property {number} back
 * @property {RoomEvent | null} last
 */
/** @typedef {{ events: RoomEvent[], oldest: number | null, newest: number | null, next?: number | null }} EventPage */
/** @typedef {{ id: number, zone: string | null, people: number, from: string, to: string }} OccupancySpan  in which the number of people stayed the same */
/** @typedef {{ spans: OccupancySpan[], next: number | null }} OccupancyPage */

/**
 * @typedef {object} RecordingStatus
 * @property {string} directory
 * @property {"recording" | "finishing" | "complete" | "failed"} state
 * @property {number} frames
 * @property {number} seconds
 * @property {number} bytes
 * @property {number} skipped
 * @property {number} lost
 * @property {number} overflowed
 * @property {"stopped" | "seconds" | "frames" | "bytes" | null} ended
 * @property {string | null} error
 */
/** @typedef {{ name?: string, seconds?: number, empty_seconds?: number }} RecordingWish */
/** @typedef {{ possible: boolean, reason: string | null, recording: RecordingStatus | null }} RecordingReport */

/**
 * How far the change on a patch stands out of the camera's noise.
 * @typedef {object} PatchSignal
 * @property {number | null} snr_db  per pixel; null if there is nothing but noise
 * @property {number} change  as a share of the floor's light
 * @property {number} noise  of one pixel, the same
 */
/** @typedef {{ sequence: number | null, left: PatchSignal | null, right: PatchSignal | null }} SignalReport  null where the noise is not known */

/** @typedef {[number, number]} Pixel  u, v; (0, 0) is the centre of the top left pixel */

/** @typedef {{ width_m: number, wall_thickness_m: number, height_m: number | null, leaf?: Leaf }} Doorway */

/** @typedef {{ k1: number, k2?: number, focal_px?: number | null }} Lens  without a focal length, that is the picture's width */
/** @typedef {"srgb" | "linear" | { gamma: number } | { curve: number[] }} Transfer */

/**
 * Where the door and points of the floor are in the camera's picture.
 * @typedef {object} Calibration
 * @property {[number, number]} size  of the picture, in pixels
 * @property {Doorway} doorway
 * @property {{ pixel: Pixel, floor_m: Point }[]} floor_points
 * @property {Lens | null} [lens]  none: as configured
 * @property {Transfer | null} [transfer]  none: as configured
 */

/**
 * How far a point is from where the fit has it.
 * @typedef {object} PointCheck
 * @property {Pixel} residual_px  where it is marked minus where the fit has it
 * @property {Point | null} residual_mm  the same on the floor; null if it is marked above the horizon
 */

/**
 * What the camera sees of the door and the floor if the calibration is right: nothing if it fits no camera.
 * @typedef {object} Overlay
 * @property {(Pixel | null)[]} edges  the feet of the door's two edges
 * @property {Pixel[]} door_line
 * @property {{ left: Pixel[], right: Pixel[] }} patches
 * @property {Pixel[][]} grid
 */

/**
 * @typedef {object} Check
 * @property {boolean} ok
 * @property {string[]} errors
 * @property {string[]} warnings  possible but unusual
 * @property {PointCheck[]} points
 * @property {{ rms_px: number, rms_mm: number, noise_px: number | null,
 *              floor_mm: number | null, angle_deg: number | null } | null} error  null if no camera fits
 * @property {Overlay} overlay
 * @property {{ left: number, right: number }} seen  share of each patch inside the picture
 */

/**
 * @typedef {object} CalibrationDocument
 * @property {boolean} editable
 * @property {string | null} reason  why it is not editable
 * @property {[number, number] | null} size  of the camera's picture now; null when there is none
 * @property {Calibration | null} calibration  in use
 * @property {Check | null} check
 * @property {boolean} previous  whether the one before is kept
 */

/** @typedef {Record<"grid" | "light" | "people" | "ellipses" | "headings" | "trails" | "zones", boolean>} Parts  of the map that are shown */
/** @typedef {{ layer: Layer, signs: Signs, brightness: Brightness }} Choice  what the selectors above the map say */

/**
 * What this browser may do.
 * @typedef {object} Session
 * @property {"read" | "control" | null} scope
 * @property {boolean} token_needed
 * @property {boolean} exposed  everybody in the network may do everything
 * @property {boolean} images  pictures of the visible side are shown
 * @property {number | null} expires_s
 * @property {string | null} [refusal]  why this page may neither change anything nor listen
 */

export {};
