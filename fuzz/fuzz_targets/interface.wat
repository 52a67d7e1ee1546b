;; A module with the functions of sdk/c/appell_plugin.h: their types, and bodies for those that have to be
;; right before the others are called.
(module
  (memory (export "memory") 2 256)
  (data (i32.const 1024) "{\"protocol\": 1, \"name\": \"fuzz\", \"inputs\": [{\"name\": \"a\", \"unit\": \"m\"}, {\"name\": \"b\", \"unit\": \"m\"}], \"outputs\": [{\"name\": \"c\", \"unit\": \"m\", \"min\": -1, \"max\": 1}, {\"name\": \"d\", \"unit\": \"m\"}], \"parameters\": [{\"name\": \"gain\", \"default\": 2}]}\00")
  (func (export "appell_abi") (result i32) i32.const 1)
  (func (export "appell_describe") (result i32) i32.const 1024)
  (func (export "appell_room") (param i32) (result i32) i32.const 4096)
  (func (export "appell_create") (param i32 i32) (result i32) i32.const 8)
  (func (export "appell_destroy") (param i32))
  (func (export "appell_step") (param i32 f64 f64 i32 i32) (result i32)
    (f64.store (local.get 4) (local.get 1))
    (f64.store offset=8 (local.get 4) (f64.load (local.get 3)))
    i32.const 0)
  (func (export "appell_step_many") (param i32 i32 i32 f64 i32 i32) (result i32) i32.const 0)
  (func (export "appell_reason") (param i32) (result i32) i32.const 0)
  (func (export "appell_save") (param i32 i32 i32) (result i32) i32.const 16)
  (func (export "appell_restore") (param i32 i32 i32) (result i32) i32.const 0)
  (func (export "appell_take_over") (param i32 i32) (result i32) i32.const 0))
