-- ArduPlane's scripting interface as far as a maneuver uses it, from bindings.desc of ArduPilot.
-- Types and ranges of arguments are checked as the generated bindings check them.
local function int(value, low, high, what)
  assert(math.type(value) == "integer" or (value == math.floor(value)), what .. " is no integer")
  assert(value >= low and value <= high, what .. " out of range: " .. value)
  return value
end

world = {
  now = 0, armed = true, mode = 5, rc = true, ekf = false, airspeed = 20.0, roll = 0.0,
  height = 100.0, load = 1.0, switch = 0, has_switch = true, scaled = {}, overrides = {},
  texts = {}, logged = 0,
  parameters = {},
}

local function output(number, kind, low, trim, high, reversed)
  local prefix = "SERVO" .. number .. "_"
  world.parameters[prefix .. "FUNCTION"] = kind
  world.parameters[prefix .. "MIN"] = low
  world.parameters[prefix .. "TRIM"] = trim
  world.parameters[prefix .. "MAX"] = high
  world.parameters[prefix .. "REVERSED"] = reversed
end

output(2, 19, 1000, 1500, 2000, 0)
output(3, 70, 1000, 1000, 2000, 0)
output(4, 21, 1100, 1480, 1900, 1)

param = {}
function param:get(name)
  assert(type(name) == "string" and #name <= 16, "parameter name")
  return world.parameters[name]
end
function param:add_table(key, prefix, count)
  int(key, 0, 200, "key"); int(count, 1, 63, "count")
  world.prefix = prefix
  return true
end
function param:add_param(key, index, name, value)
  int(key, 0, 200, "key"); int(index, 1, 63, "index")
  assert(#(world.prefix .. name) <= 16, "parameter name")
  world.parameters[world.prefix .. name] = value
  return true
end
function Parameter()
  local made = {}
  function made:init(name) self.name = name; return world.parameters[name] ~= nil end
  function made:get() return world.parameters[self.name] end
  return made
end

SRV_Channels = {}
function SRV_Channels:get_output_scaled(kind)
  return world.scaled[int(kind, 0, 180, "function")] or 0.0
end
function SRV_Channels:set_output_pwm_chan_timeout(channel, pulse, timeout)
  world.overrides[int(channel, 0, 31, "channel")] =
    { pulse = int(pulse, 0, 65535, "pulse"), until_ms = world.now + int(timeout, 0, 65535, "timeout") }
end

arming = {}
function arming:is_armed() return world.armed end
vehicle = {}
function vehicle:get_mode() return world.mode end
function vehicle:has_ekf_failsafed() return world.ekf end
rc = {}
function rc:has_valid_input() return world.rc end
function rc:find_channel_for_option(option)
  assert(option == 300)
  if not world.has_switch then return nil end
  return { get_aux_switch_pos = function() return world.switch end }
end
ahrs = {}
function ahrs:airspeed_estimate() return world.airspeed end
function ahrs:get_roll() return world.roll end
function ahrs:get_relative_position_D_home() return -world.height end
function ahrs:get_accel() return { z = function() return -9.80665 * world.load end } end
gcs = {}
function gcs:send_text(severity, text)
  int(severity, 0, 7, "severity")
  assert(type(text) == "string")
  table.insert(world.texts, text)
end
logger = {}
function logger:write(name, labels, format, ...)
  assert(#name <= 4 and #format == select("#", ...))
  world.logged = world.logged + 1
end
function millis() return { toint = function() return world.now end } end
